// Bodies that move on the device. Without forces a run agrees with the run on Reference to
// rounding, for every scheme, kind of body, noise law and precision of the platform, so the tests
// need no statistics.

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/MonteCarloAnisotropicBarostat.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/MonteCarloMembraneBarostat.h>
#include <openmm/NonbondedForce.h>
#include <openmm/serialization/XmlSerializer.h>

#include <memory>
#include <sstream>

#include "DeviceSupport.h"
#include "WaterBoxSupport.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** Without forces, the device moves bodies and free particles as Reference does. */
void expectTheMovesOfReference(CustomRigidHIIntegrator::Scheme scheme,
                               CustomRigidHIIntegrator::NoiseLaw law, double inertiaScale,
                               int steps) {
    SCOPED_TRACE("scheme " + to_string(scheme) + ", law " + to_string(law) + ", inertia times " +
                 to_string(inertiaScale));
    Bodies device, host;
    for (Bodies* each : {&device, &host}) {
        each->integrator.setScheme(scheme);
        each->integrator.setNoiseLaw(law);
        each->integrator.setInertiaScale(inertiaScale);
    }
    device.start(testPlatformName());
    host.start("Reference");
    device.integrator.step(steps);
    host.integrator.step(steps);
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(bodiesKey);
    // Rounding adds up along a path of some nm. Angles of fast rotors grow with time.
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
    // Positions of free particles are set through the Context, which rounds them.
    const auto x = positionsOf(*device.context), y = positionsOf(*host.context);
    for (size_t p = device.firstFree; p < x.size(); p++)
        EXPECT_LT(norm(x[p] - y[p]), readTolerance(1e-12, 4));
    // Particles have the velocities of their bodies.
    const auto a = velocitiesOf(*device.context), b = velocitiesOf(*host.context);
    for (int p = 0; p < device.firstFree; p++)
        EXPECT_LT(norm(a[p] - b[p]), readTolerance(1e-11, 5)) << "particle " << p;
    EXPECT_EQ(device.integrator.getStepStatistics().at("randomNumbers"),
              host.integrator.getStepStatistics().at("randomNumbers"));
    EXPECT_EQ(device.context->getStepCount(), steps);
    EXPECT_NEAR(device.context->getState(0).getTime(), 0.002 * steps, 1e-9);
}

}  // namespace

TEST(DeviceSteps, WithoutForcesPosesAndFreeParticlesAreThoseOfReference) {
    for (auto scheme : thermostats())
        expectTheMovesOfReference(scheme, CustomRigidHIIntegrator::Gaussian,
                                  scheme == CustomRigidHIIntegrator::LangevinC ? 4 : 1, 300);
    for (auto law : {CustomRigidHIIntegrator::ThreePoint, CustomRigidHIIntegrator::TwoPoint})
        expectTheMovesOfReference(CustomRigidHIIntegrator::LangevinB, law, 1, 300);
}

// Where the fluid couples nothing, the friction of each body is its own tensor.
TEST(DeviceSteps, LangevinHIWithoutCouplingMovesBodiesAsOnReference) {
    Bodies device, host;
    for (Bodies* each : {&device, &host}) {
        each->integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
        auto* fluid = new MobilityForce();
        fluid->setModel(MobilityForce::FreeDraining);
        for (int p = 0; p < each->system.getNumParticles(); p++)
            fluid->addParticle(p < each->firstFree ? 0 : 0.02);
        // Isotropic in translation, diagonal in rotation, without coupling.
        vector<double> friction(36);
        for (int k = 0; k < 6; k++) friction[7 * k] = k < 3 ? 200 : 0.1 * k;
        for (int b = 0; b < each->numBodies; b++) fluid->setBodyFriction(b, friction);
        each->system.addForce(fluid);
    }
    device.start(testPlatformName());
    host.start("Reference");
    device.integrator.step(300);
    host.integrator.step(300);
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(bodiesKey);
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
}

TEST(DeviceSteps, FullEveryLawAndInertiaScaleMovesBodiesAsOnReference) {
    for (auto scheme : thermostats())
        for (auto law : {CustomRigidHIIntegrator::Gaussian, CustomRigidHIIntegrator::ThreePoint,
                         CustomRigidHIIntegrator::TwoPoint})
            for (double scale : {1.0, 4.0}) expectTheMovesOfReference(scheme, law, scale, 1000);
}

// OpenMM sorts particles and wraps them into the box every 250 steps, while bodies leave the box.
TEST(DeviceSteps, SortingAndImagesChangeNothing) {
    Bodies device, host;
    for (Bodies* each : {&device, &host}) each->integrator.setFriction(0);
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host}) {
        vector<Vec3> v(each->numBodies);
        for (int b = 0; b < each->numBodies; b++)
            v[b] = Vec3(3, -2, 1) * (b % 5) + Vec3(0.013, 0.017, -0.011) * b;
        each->integrator.setBodyVelocities(v);
        each->integrator.step(1200);
    }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-12);  // after up to 36 nm
    const auto a = positionsOf(*device.context), b = positionsOf(*host.context);
    for (int p = 0; p < device.firstFree; p++)
        EXPECT_LT(norm(a[p] - b[p]), readTolerance(1e-12, 40));
}

TEST(DeviceSteps, TransferNothingInSteps) {
    for (bool removes : {false, true}) {
        Bodies device(0.5);
        if (removes) device.system.addForce(new CMMotionRemover(3));
        device.start(testPlatformName());
        device.integrator.step(10);
        map<string, double> last = device.integrator.getStepStatistics();
        const auto spentIn = [&](int steps, int calls = 1) {
            for (int i = 0; i < calls; i++) device.integrator.step(steps);
            const auto now = device.integrator.getStepStatistics();
            map<string, double> spent;
            for (const auto& [name, value] : now) spent[name] = value - last.at(name);
            last = now;
            EXPECT_EQ(spent.at("steps"), steps * calls);
            return spent;
        };
        // The user has asked for statistics before and after: states go to the device and back, and
        // the host reads positions and velocities, which the user might have changed.
        EXPECT_EQ(spentIn(1).at("deviceTransfers"), 4);
        const auto spent = spentIn(1000);
        EXPECT_EQ(spent.at("deviceTransfers"), 4);
        // A flag every hundred steps, one at the start, and sums for the watch of temperatures.
        EXPECT_LE(spent.at("deviceLooks"), 25);
        // OpenMM's Verlet integrator has two kernels a step, and so have these; two more where
        // momentum is removed; and some for each sorting.
        EXPECT_LE(spent.at("deviceLaunches"), 2 * 1000 + (removes ? 2 * 334 : 0) + 50);
        // Steps one by one stay there, too.
        EXPECT_EQ(spentIn(1, 100).at("deviceTransfers"), 4);
    }
}

// Where the host moves bodies, each step sends positions and gets forces.
TEST(DeviceSteps, TransfersOfTheHostAreCounted) {
    setenv("RIGIDHI_BODIES_ON_HOST", "1", 1);
    Bodies host(0.5);
    host.start(testPlatformName());
    unsetenv("RIGIDHI_BODIES_ON_HOST");
    host.integrator.step(10);
    const double before = host.integrator.getStepStatistics().at("deviceTransfers");
    host.integrator.step(100);
    const double spent = host.integrator.getStepStatistics().at("deviceTransfers") - before;
    EXPECT_GE(spent, 2 * 100);
    EXPECT_LE(spent, 2 * 100 + 5);
}

TEST(DeviceSteps, StepsOneByOneAreTheSame) {
    vector<Vec3> ends[2];
    for (int chunk : {1, 60}) {
        Bodies device(0.5);
        device.start(testPlatformName());
        for (int i = 0; i < 60 / chunk; i++) device.integrator.step(chunk);
        ends[chunk == 1] = device.integrator.getBodyPositions();
    }
    EXPECT_TRUE(sameBits(ends[0], ends[1]));
}

TEST(DeviceSteps, ResumeBitForBitFromCheckpoints) {
    Bodies whole(0.5), first(0.5), second(0.5);
    whole.start(testPlatformName());
    first.start(testPlatformName());
    second.start(testPlatformName());
    whole.integrator.step(300);
    whole.integrator.step(300);
    first.integrator.step(300);
    stringstream checkpoint;
    first.context->createCheckpoint(checkpoint);
    second.integrator.step(7);
    second.context->loadCheckpoint(checkpoint);
    second.integrator.step(300);
    ASSERT_TRUE(areOnTheDevice(second.integrator));
    EXPECT_TRUE(
        sameBits(whole.integrator.getBodyPositions(), second.integrator.getBodyPositions()));
    EXPECT_TRUE(
        sameBits(whole.integrator.getBodyVelocities(), second.integrator.getBodyVelocities()));
}

TEST(DeviceSteps, StatesGoToAnotherPrecision) {
    Bodies first, second;
    first.start(testPlatformName());
    first.integrator.step(50);
    const State state = first.context->getState(State::Positions | State::Velocities |
                                                State::IntegratorParameters | State::Parameters);
    second.start(testPlatformName(),
                 {{"Precision", testPrecision() == "double" ? "single" : "double"}});
    second.context->setState(state);
    first.integrator.step(50);
    second.integrator.step(50);
    ASSERT_TRUE(areOnTheDevice(second.integrator));
    EXPECT_LT(poseDifference(first.integrator, second.integrator), 1e-13);
}

TEST(DeviceSteps, SettingsTakeEffectAtTheNextStep) {
    Bodies device, host;
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host}) {
        each->integrator.step(20);
        each->integrator.setTemperature(100);
        each->integrator.step(20);
        each->integrator.setStepSize(0.001);
        each->integrator.setScheme(CustomRigidHIIntegrator::LangevinA);
        each->integrator.step(20);
        each->integrator.setBodyHeld(3, true);
        each->integrator.setBodyFriction(0, 100, 200);
        each->integrator.step(20);
        each->integrator.setBodyHeld(3, false);
        each->integrator.step(20);
    }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
}

TEST(DeviceSteps, ChangesByUsersAreTakenIn) {
    Bodies device, host;
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host}) {
        each->integrator.step(20);
        // Bodies in the middle of a run, by the Context and by the integrator.
        auto R = each->integrator.getBodyPositions();
        for (Vec3& r : R) r += Vec3(0.1, -0.2, 0.3);
        each->integrator.setBodyPositions(R);
        each->integrator.step(20);
        auto v = each->integrator.getBodyVelocities();
        for (Vec3& u : v) u *= -0.5;
        each->integrator.setBodyVelocities(v);
        each->integrator.step(20);
    }
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
    for (Bodies* each : {&device, &host}) {
        auto x = positionsOf(*each->context);
        for (Vec3& r : x) r += Vec3(0.05, 0, 0);
        each->context->setPositions(x);
        each->integrator.step(20);
        auto v = velocitiesOf(*each->context);
        for (Vec3& u : v) u *= 1.5;
        each->context->setVelocities(v);
        each->integrator.step(20);
    }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    // What goes through the Context has the platform's precision.
    EXPECT_LT(poseDifference(device.integrator, host.integrator), readTolerance(1e-12, 4) * 10);
    // A body that does not fit its shape any more is refused, as on the host.
    auto x = positionsOf(*device.context);
    x[0] += Vec3(0.1, 0, 0);
    device.context->setPositions(x);
    expectError([&] { device.integrator.step(5); }, {"body 0", "from its place in the body"});
}

// OpenMM does not tell the integrator that a user has applied constraints to the particles.
TEST(DeviceSteps, ConstraintsThatAUserAppliesAreTakenIn) {
    Bodies device;
    device.start(testPlatformName());
    device.integrator.step(20);
    auto q = device.integrator.getBodyOrientations();
    device.context->applyConstraints(1e-8);
    device.integrator.step(1);
    EXPECT_EQ(device.integrator.getEffects().at(bodiesKey).substr(0, 3), "on:");
}

TEST(DeviceSteps, MomentumRemoversAct) {
    // The momentum of all bodies becomes 0, whatever their masses are, when the remover is due.
    for (int frequency : {1, 7}) {
        Bodies device, host;
        for (Bodies* each : {&device, &host}) {
            each->system.addForce(new CMMotionRemover(frequency));
            each->integrator.setFriction(0);
        }
        device.start(testPlatformName());
        host.start("Reference");
        device.integrator.step(50);
        host.integrator.step(50);
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-12);
    }
    // A remover acts once on free particles, too, whenever a run begins.
    vector<Vec3> ends[2];
    for (int chunk : {1, 20}) {
        Bodies device;
        device.system.addForce(new CMMotionRemover());
        device.start(testPlatformName());
        auto v = velocitiesOf(*device.context);
        for (size_t p = device.firstFree; p < v.size(); p++) v[p] = Vec3(3, 1, 2);
        device.context->setVelocities(v);
        for (int i = 0; i < 20 / chunk; i++) device.integrator.step(chunk);
        ends[chunk == 1] = positionsOf(*device.context);
    }
    EXPECT_TRUE(sameBits(ends[0], ends[1]));
    WaterBox box(3, 0.002, true);
    box.system.addForce(new CMMotionRemover());
    box.start();
    box.context->setVelocitiesToTemperature(300, 1);
    box.integrator.setFriction(0);
    box.integrator.setRotationalFriction(0);
    box.integrator.step(100);
    ASSERT_TRUE(areOnTheDevice(box.integrator)) << box.integrator.getEffects().at(bodiesKey);
    Vec3 p;
    for (const Vec3& v : box.integrator.getBodyVelocities()) p += v;
    // The forces, in single precision, do not add up to 0 in the last step.
    EXPECT_LT(norm(p), testPrecision() == "double" ? 1e-6 : 1e-2);
}

TEST(DeviceSteps, BarostatsMoveWholeBodies) {
    const int interval = 6;
    const double kelvin = 20, bar = 30;
    auto* isotropic = new MonteCarloBarostat(bar, kelvin, interval);
    auto* anisotropic =
        new MonteCarloAnisotropicBarostat(Vec3(bar, bar, bar), kelvin, true, true, true, interval);
    auto* membrane =
        new MonteCarloMembraneBarostat(bar, 0, kelvin, MonteCarloMembraneBarostat::XYIsotropic,
                                       MonteCarloMembraneBarostat::ZFree, interval);
    isotropic->setRandomNumberSeed(4);
    anisotropic->setRandomNumberSeed(4);
    membrane->setRandomNumberSeed(4);
    for (Force* barostat : initializer_list<Force*>{isotropic, anisotropic, membrane}) {
        SCOPED_TRACE(barostat->getName());
        Bodies device(0.6, 0.002, 2.2);
        device.system.addForce(barostat);
        device.start(testPlatformName());
        int accepted = 0, kept = 0;
        vector<Vec3> last;
        double volume = device.context->getState(0).getPeriodicBoxVolume();
        for (int i = 0; i < 100; i++) {
            device.integrator.step(interval);
            const double now = device.context->getState(0).getPeriodicBoxVolume();
            (now != volume ? accepted : kept)++;
            volume = now;
            // The pose is that of the particles.
            const auto x = positionsOf(*device.context);
            const auto R = device.integrator.getBodyPositions();
            EXPECT_LT(norm(x[5] - R[2]), readTolerance(1e-12, 10));  // a point
            // OpenMM wraps particles into the box, but poses stay in their images.
            for (int b = 0; i > 0 && b < device.numBodies; b++)
                EXPECT_LT(norm(R[b] - last[b]), 0.5);
            last = R;
        }
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        EXPECT_GT(accepted, 10);
        EXPECT_GT(kept, 2);
        const auto x = positionsOf(*device.context);
        EXPECT_NEAR(norm(x[1] - x[2]), 0.16, 1e-5);
    }
}

// A barostat asks for energies in the middle of a step.
TEST(DeviceSteps, BarostatsBringNoBodiesBack) {
    for (double pressure : {1.0, 1e5}) {
        Bodies device(0.5, 0.002, 2.4);
        device.system.addForce(new MonteCarloBarostat(pressure, 1e-3, 5));
        device.start(testPlatformName());
        device.integrator.step(10);
        const auto before = device.integrator.getStepStatistics();
        device.integrator.step(50);
        const auto after = device.integrator.getStepStatistics();
        // States, positions and velocities once, and images after each move that the barostat
        // tries.
        EXPECT_LE(after.at("deviceTransfers") - before.at("deviceTransfers"), 4 + 10);
        EXPECT_LE(after.at("forceEvaluations") - before.at("forceEvaluations"), 50 + 10);
    }
}

TEST(DeviceSteps, UsersSetStatesBesideABarostat) {
    Bodies device(0.5);
    device.system.addForce(new MonteCarloBarostat(1, 300, 1000));
    device.start(testPlatformName());
    device.integrator.step(5);
    const auto step = [&] {
        device.integrator.step(5);
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        device.integrator.step(5);  // getEffects() has brought bodies back
    };
    const double close = readTolerance(1e-12, 10);
    const auto expectPositions = [&](const vector<Vec3>& x) {
        const auto found = positionsOf(*device.context);
        for (size_t p = 0; p < x.size(); p++) EXPECT_LT(norm(found[p] - x[p]), close);
        EXPECT_LT(norm(device.integrator.getBodyPositions()[2] - x[5]), close);  // a point
    };
    auto x = positionsOf(*device.context), v = velocitiesOf(*device.context);
    for (Vec3& r : x) r += Vec3(0.05, 0.02, -0.03);
    step();
    device.context->setPositions(x);
    expectPositions(x);
    step();
    for (Vec3& u : v) u *= 2;
    device.context->setVelocities(v);
    const auto found = velocitiesOf(*device.context);
    for (size_t p = 0; p < v.size(); p++) EXPECT_LT(norm(found[p] - v[p]), close);
    EXPECT_LT(norm(device.integrator.getBodyVelocities()[2] - v[5]), close);

    step();
    stringstream checkpoint;
    device.context->createCheckpoint(checkpoint);
    x = positionsOf(*device.context);
    step();
    device.context->loadCheckpoint(checkpoint);
    expectPositions(x);
    const State state = device.context->getState(State::Positions | State::Velocities |
                                                 State::IntegratorParameters | State::Parameters);
    step();
    device.context->setState(state);
    expectPositions(x);
    step();
}

// A barostat that fails in the middle of a run leaves the state before the step.
TEST(DeviceSteps, FailuresOfForcesLeaveTheStateBeforeTheStep) {
    for (int chunk : {1, 7}) {
        Bodies device;
        device.system.addForce(new MonteCarloBarostat(1e6, 300, 5));
        device.start(testPlatformName());
        vector<Vec3> R;
        double volume = 0;
        long long count = 0;
        const auto look = [&] {
            R = device.integrator.getBodyPositions();
            volume = device.context->getState(0).getPeriodicBoxVolume();
            count = device.context->getStepCount();
        };
        expectError(
            [&] {
                for (int i = 0; i < 2000; i++) {
                    look();
                    device.integrator.step(chunk);
                }
            },
            {"box size has decreased"});
        const auto now = device.integrator.getBodyPositions();
        const auto x = positionsOf(*device.context);
        EXPECT_LT(norm(x[5] - now[2]), readTolerance(1e-12, 10));
        EXPECT_LT(device.context->getStepCount() - count, chunk);
        if (chunk > 1) continue;
        EXPECT_EQ(device.context->getState(0).getPeriodicBoxVolume(), volume);
        for (int b = 0; b < device.numBodies; b++)
            EXPECT_LT(norm(now[b] - R[b]), readTolerance(1e-12, 10));
    }
}

// The device computes the sums of the watch. TestTemperatures tests what the watch must find.
TEST(DeviceSteps, TheWatchOfTemperaturesHasNoFalseAlarms) {
    // Without forces a step takes as long for many bodies.
    Bodies device(0, 0.002, 2.4, 72);
    device.system.removeForce(0);
    device.system.addForce(new CMMotionRemover(10));
    device.start(testPlatformName());
    // The first window of 4000 steps is left out, and three are judged, also together: rotations
    // that seem a quarter too hot are found then.
    device.integrator.step(16100);
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_EQ(device.integrator.getEffects().at("warnings"), "off: none");
}

TEST(DeviceSteps, NonFiniteForcesNameStepAndBody) {
    for (int bad : {3, 130}) {
        System system;
        CustomRigidHIIntegrator integrator(0, 0.1);
        integrator.setFriction(0);
        vector<Vec3> positions;
        for (int i = 0; i < 3; i++) {
            system.addParticle(1.0);
            integrator.addRigidBody({i}, 1.0, Vec3(), {Vec3()});
            positions.push_back(Vec3(i == 1 ? 0.2 * bad - 0.05 : 500.0, 0, 0));
        }
        auto* force = new CustomExternalForce("1e-9*sqrt(x)");  // not a number for x < 0
        for (int i = 0; i < 3; i++) force->addParticle(i, vector<double>());
        system.addForce(force);
        Context context(system, integrator, testPlatform());
        context.setPositions(positions);
        context.setVelocities({Vec3(), Vec3(-2, 0, 0), Vec3()});
        expectError([&] { integrator.step(1000); },
                    {"step " + to_string(bad), "body 1", "non-finite", "smaller step"});
        EXPECT_EQ(context.getStepCount(), bad - 1);
        EXPECT_NEAR(integrator.getBodyPositions()[1][0], 0.15, 1e-6);
    }
}

// OpenMM adds forces of devices as whole numbers, where two that are not finite cancel.
TEST(DeviceSteps, ForcesThatCancelWithoutBeingFiniteAreFound) {
    for (bool onHost : {false, true}) {
        System system;
        CustomRigidHIIntegrator integrator(300, 0.002);
        for (int i = 0; i < 2; i++) {
            system.addParticle(20.0);
            integrator.addRigidBody({i}, 20.0, Vec3(), {Vec3()});
        }
        for (int i = 0; i < 2; i++) {
            auto* force = new CustomExternalForce("sqrt(x)");
            force->addParticle(0, vector<double>());
            system.addForce(force);
        }
        if (onHost) setenv("RIGIDHI_BODIES_ON_HOST", "1", 1);
        Context context(system, integrator, testPlatform());
        unsetenv("RIGIDHI_BODIES_ON_HOST");
        context.setPositions({Vec3(1, 0, 0), Vec3(2, 0, 0)});
        integrator.step(3);
        const auto before = integrator.getBodyPositions();
        context.setPositions({Vec3(-1, 0, 0), before[1]});
        for (int i = 0; i < 2; i++)
            expectError([&] { integrator.step(5); },
                        {"step 4", "the potential energy is not a number", "may cancel"});
        EXPECT_EQ(context.getStepCount(), 3);
        // The Context goes on from good positions.
        context.setPositions({Vec3(1, 0, 0), before[1]});
        integrator.step(5);
        EXPECT_EQ(context.getStepCount(), 8);
    }
}

// A barostat draws other random numbers when the host repeats steps, and the message says so.
TEST(DeviceSteps, RepeatedStepsBesideABarostatAreNamed) {
    Bodies device;
    device.system.addForce(new MonteCarloBarostat(1, 300, 5));
    // Not a number for t > 1.
    auto* force = new CustomExternalForce("1e-9*x*sqrt(1 - t)");
    force->addGlobalParameter("t", 0);
    force->addParticle(0, vector<double>());
    device.system.addForce(force);
    device.start(testPlatformName());
    device.integrator.step(20);
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    device.context->setParameter("t", 2);
    expectError([&] { device.integrator.step(50); },
                {"step 21", "body 0", "other random numbers of the barostat"});
    EXPECT_EQ(device.context->getStepCount(), 20);
}

TEST(DeviceSteps, TwoContextsOfADeviceShareForces) {
    Bodies one(0.5), two(0.5);
    one.start(testPlatformName(), {{"DeviceIndex", "0"}});
    two.start(testPlatformName(), {{"DeviceIndex", "0,0"}});
    one.integrator.step(50);
    two.integrator.step(50);
    ASSERT_TRUE(areOnTheDevice(two.integrator));
    EXPECT_LT(poseDifference(one.integrator, two.integrator),
              testPrecision() == "double" ? 1e-6 : 1e-4);
}

TEST(DeviceSteps, ForceGroupsAreThoseOfTheIntegrator) {
    Bodies device, host;
    for (Bodies* each : {&device, &host}) {
        for (int group : {1, 2}) {
            auto* force = new CustomExternalForce(group == 1 ? "10*x" : "-30*y");
            force->setForceGroup(group);
            for (int i = 0; i < each->system.getNumParticles(); i++)
                force->addParticle(i, vector<double>());
            each->system.addForce(force);
        }
    }
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host})
        for (int groups : {1 << 1, 1 << 2, 0xff}) {
            each->integrator.setIntegrationForceGroups(groups);
            each->integrator.step(10);
        }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-7);
}
