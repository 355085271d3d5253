// Mismatched versions of libraries are detected, and the message names the version of each.

#include <gtest/gtest.h>
#include <openmm/Context.h>
#include <openmm/OpenMMException.h>
#include <openmm/Platform.h>
#include <openmm/reference/ReferencePlatform.h>

#include <memory>
#include <string>

#include "kernel/KernelFactory.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/Version.h"

using namespace OpenMM;
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
    EXPECT_EQ(Platform::getOpenMMVersion().find(getOpenMMVersionOfBuild()), 0u);
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

// OpenMM loads a library that was compiled for another OpenMM if it finds all symbols. Such a
// library must not run.
TEST(Versions, AContextWithALibraryOfAnotherOpenMMIsRefused) {
    struct Other : ReferencePlatform {
        const string& getName() const override {
            static const string name = "Other";
            return name;
        }
    };
    Platform::registerPlatform(new Other);
    PlatformParts parts;
    parts.arrays = [](ContextImpl&) -> unique_ptr<ContextArrays> {
        throw OpenMMException("the library of another OpenMM ran");
    };
    registerKernel("Other", "OpenMMRigidHIOther", parts, "99.1");
    System system;
    system.addParticle(1);
    CustomRigidHIIntegrator integrator(300, 0.001);
    integrator.addRigidBody({0});
    try {
        Context context(system, integrator, Platform::getPlatformByName("Other"));
        FAIL();
    } catch (const OpenMMException& error) {
        expectParts(error.what(), {"OpenMMRigidHIOther: it was compiled for OpenMM 99.1",
                                   "but the loaded OpenMM has version",
                                   "build openmm-rigidhi against the loaded OpenMM"});
    }
}
