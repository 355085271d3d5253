// Mismatched versions of libraries are detected, and the message names the version of each.

#include <gtest/gtest.h>
#include <openmm/Platform.h>

#include <string>

#include "openmmrigidhi/Version.h"

using namespace RigidHIPlugin;
using namespace std;

namespace {

void expectParts(const string& message, const initializer_list<string>& parts) {
    for (const string& part : parts)
        EXPECT_NE(message.find(part), string::npos) << part << " is not in: " << message;
}

}  // namespace

TEST(Versions, BelongTogether) {
    EXPECT_EQ(versionConflict("this test", getVersion(), getOpenMMVersionOfBuild()), "");
    // The OpenMM that runs here is the one that was compiled for.
    EXPECT_EQ(OpenMM::Platform::getOpenMMVersion().find(getOpenMMVersionOfBuild()), 0u);
}

TEST(Versions, OpenMMOfAnotherVersionIsNoticed) {
    for (const string other : {"1.0", "7", "7.70", "99.1"})
        expectParts(
            versionConflict("libExample", getVersion(), other),
            {"libExample: it was compiled for OpenMM " + other, "but the loaded OpenMM has version",
             "build openmm-rigidhi against the loaded OpenMM"});
}

TEST(Versions, AnotherCopyOfTheLibraryIsNoticed) {
    expectParts(versionConflict("libExample", "0.0.1", getOpenMMVersionOfBuild()),
                {"libExample: it is version 0.0.1", getLibraryPath(),
                 "which was loaded before it, is version " + getVersion(),
                 "this process mixes two copies of openmm-rigidhi"});
    EXPECT_NE(getLibraryPath().find("libOpenMMRigidHI.so"), string::npos);
}
