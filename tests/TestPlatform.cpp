// The only object that is compiled for each platform. It tells the tests in platform/ on which
// platform they run.

#include <openmm/VerletIntegrator.h>

#include <algorithm>

#include "TestSupport.h"

using namespace std;

namespace RigidHITest {

string testPlatformName() { return RIGIDHI_TEST_PLATFORM; }

double readTolerance(double tolerance, double scale) {
    if (!onDevice()) return tolerance;
    // This allows for several roundings. The precision "mixed" has positions in single precision
    // while it sorts particles.
    return max(tolerance, scale * 8 * pow(2, testPrecision() == "double" ? -53 : -24));
}

double forceTolerance(double tolerance, double scale) {
    if (!onDevice()) return tolerance;
    // Sums are in fixed point with 32 bits after the point. Functions such as 1/r have single
    // precision even where numbers have double precision.
    return max(tolerance, scale * (testPrecision() == "double" ? 1e-7 : 1e-5));
}

namespace {

/** Skips the tests of a device platform, with a message, if the machine has no such device. */
class NeedsDevice : public testing::Environment {
    void SetUp() override {
        OpenMM::System system;
        system.addParticle(1);
        OpenMM::VerletIntegrator integrator(0.001);
        try {
            OpenMM::Context context(system, integrator, RigidHITest::testPlatform());
        } catch (const OpenMM::OpenMMException& e) {
            GTEST_SKIP() << "no device for platform " << RigidHITest::testPlatformName() << ": "
                         << e.what();
        }
    }
};

testing::Environment* const needed =
    onDevice() ? testing::AddGlobalTestEnvironment(new NeedsDevice) : nullptr;

}  // namespace

}  // namespace RigidHITest
