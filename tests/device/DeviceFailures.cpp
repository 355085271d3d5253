// Where a device refuses double precision, a kernel or memory, the host moves bodies as if there
// were no device, and the reason is said.

#include <openmm/internal/ContextImpl.h>

#include "DeviceOfTests.h"
#include "DevicePlatform.h"
#include "DeviceSupport.h"
#include "TestSupport.h"
#include "WaterBoxSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace RigidHIPlugin;
using namespace std;

namespace {

/** A device that has no memory any more after some requests. */
struct NoMemory : Device {
    explicit NoMemory(ComputeContext& context) : Device(context) { alive++; }
    ~NoMemory() override { alive--; }
    void requireMemory(size_t) const override {
        if (requestsLeft-- <= 0) throw OpenMMException("Error creating array: clCreateBuffer (-4)");
    }
    static int requestsLeft, alive;
};
int NoMemory::requestsLeft = 0, NoMemory::alive = 0;

/** Contexts have devices of the kind that a test chooses. */
struct DeviceFailures : testing::Test {
    template <class Kind>
    void use() {
        testPlatform();  // loads the plugin, which registers its own kernels
        registerDevicePlatform<DevicePlatform, Kind>(testPlatformName());
    }
    void TearDown() override { use<Device>(); }
};

struct Waters : WaterBox {
    string warnings;
    Waters() : WaterBox(2, 0.002, true) { start(); }
    void step(int steps) {
        testing::internal::CaptureStderr();
        integrator.step(steps);
        warnings = testing::internal::GetCapturedStderr();
    }
    string effect(const char* key) const { return integrator.getEffects().at(key); }
};

/** The waters move as on the host. */
void expectStepsOfTheHost(Waters& waters) {
    setenv("RIGIDHI_BODIES_ON_HOST", "1", 1);
    Waters host;
    host.step(20);
    unsetenv("RIGIDHI_BODIES_ON_HOST");
    EXPECT_TRUE(sameBits(waters.integrator.getBodyPositions(), host.integrator.getBodyPositions()));
    EXPECT_EQ(waters.context->getStepCount(), 20);
}

}  // namespace

TEST_F(DeviceFailures, WithoutDoublesTheHostMovesBodies) {
    use<NoDoubles>();
    Waters waters;
    waters.step(20);
    EXPECT_EQ(waters.effect(bodiesKey),
              "off: the host moves bodies: the device has no double precision, which poses and "
              "momenta need");
    EXPECT_NE(waters.effect("products on the device").find("the device has no double precision"),
              string::npos);
    EXPECT_EQ(waters.integrator.getStepStatistics().at("deviceLaunches"), 0);
    expectStepsOfTheHost(waters);
}

TEST_F(DeviceFailures, TheLogOfTheCompilerIsSaid) {
    use<NoKernels>();
    Waters waters;
    waters.step(20);
    const string effect = waters.effect(bodiesKey);
    EXPECT_EQ(effect.substr(0, 4), "off:");
    for (const char* part : {"the host moves bodies: the device cannot take them: its compiler "
                             "refuses a kernel: ",
                             "WordThatNoCompilerKnows"})
        for (const string& text : {effect, waters.warnings})
            EXPECT_NE(text.find(part), string::npos) << text;
    expectStepsOfTheHost(waters);
    waters.step(2);
    EXPECT_EQ(waters.warnings.find("compiler"), string::npos) << "a second time";
}

TEST_F(DeviceFailures, LackOfMemoryIsSaidAndMemoryIsFreed) {
    use<NoMemory>();
    for (int requests : {0, 9, 28}) {
        NoMemory::requestsLeft = requests;
        Waters waters;
        EXPECT_EQ(NoMemory::alive, 2);  // for bodies and for products
        waters.step(20);
        const string effect = waters.effect(bodiesKey);
        for (const char* part : {"off: the host moves bodies: the device cannot take them: it "
                                 "cannot hold ",
                                 " bytes of ", ": Error creating array: clCreateBuffer (-4)"})
            EXPECT_NE(effect.find(part), string::npos) << effect;
        EXPECT_EQ(NoMemory::alive, 1) << "arrays of bodies";
        expectStepsOfTheHost(waters);
    }
    // Bodies that are on the device go on where they are, if it has no memory for their next
    // settings.
    NoMemory::requestsLeft = 1000;
    Waters waters;
    waters.step(10);
    ASSERT_EQ(waters.effect(bodiesKey).substr(0, 3), "on:");
    NoMemory::requestsLeft = 0;
    const auto before = waters.integrator.getBodyPositions();
    waters.integrator.setTemperature(200);
    waters.step(1);
    EXPECT_EQ(waters.effect(bodiesKey).substr(0, 4), "off:");
    const auto after = waters.integrator.getBodyPositions();
    for (size_t b = 0; b < before.size(); b++) EXPECT_LT(norm(after[b] - before[b]), 0.01);
    EXPECT_EQ(waters.context->getStepCount(), 11);
}
