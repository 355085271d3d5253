// The only object that is compiled for each platform. It tells the tests in platform/ on which
// platform they run.

#include <dlfcn.h>
#include <openmm/VerletIntegrator.h>

#include <algorithm>
#include <cstdint>

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

/** Whether OpenCL has a device. A Context would compile OpenMM's kernels to find out. */
bool hasOpenCLDevice() {
    void* library = dlopen("libOpenCL.so.1", RTLD_LAZY);
    if (!library) return false;
    using GetPlatforms = int (*)(unsigned, void**, unsigned*);
    using GetDevices = int (*)(void*, uint64_t, unsigned, void**, unsigned*);
    const auto getPlatforms = (GetPlatforms)dlsym(library, "clGetPlatformIDs");
    const auto getDevices = (GetDevices)dlsym(library, "clGetDeviceIDs");
    if (!getPlatforms || !getDevices) return false;
    const uint64_t anyType = 0xFFFFFFFF;
    void* platforms[16];
    unsigned count = 0, devices = 0;
    if (getPlatforms(16, platforms, &count) != 0) return false;
    for (unsigned i = 0; i < min(count, 16u); i++)
        if (getDevices(platforms[i], anyType, 0, nullptr, &devices) == 0 && devices > 0)
            return true;
    return false;
}

/** Skips the tests of a device platform, with a message, if the machine has no such device. */
class NeedsDevice : public testing::Environment {
    void SetUp() override {
        try {
            OpenMM::Platform& platform = RigidHITest::testPlatform();
            if (testPlatformName() == "OpenCL" && hasOpenCLDevice()) return;
            OpenMM::System system;
            system.addParticle(1);
            OpenMM::VerletIntegrator integrator(0.001);
            OpenMM::Context context(system, integrator, platform);
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
