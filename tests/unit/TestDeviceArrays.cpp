// These tests use a platform that imitates a device. It keeps particles in single precision and
// forces in fixed point, as OpenMM's device platforms do. The tests check promises for such
// platforms to the last bit, without the tolerances that real devices need.

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/KernelFactory.h>
#include <openmm/VirtualSite.h>
#include <openmm/internal/ContextImpl.h>
#include <openmm/internal/ForceImpl.h>
#include <openmm/kernels.h>
#include <openmm/reference/ReferencePlatform.h>
#include <openmm/serialization/XmlSerializer.h>

#include <memory>
#include <sstream>

#include "TestSupport.h"
#include "context/KernelArrays.h"
#include "host/ScalarLoops.h"
#include "kernel/RigidBodyKernel.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

Vec3 inFloats(const Vec3& x) { return Vec3(float(x[0]), float(x[1]), float(x[2])); }

/** OpenMM has this method from 8.1 on. */
template <class Kernel>
auto shiftVelocities(Kernel& kernel, ContextImpl& context, double time, vector<Vec3>& velocities,
                     int) -> decltype(kernel.computeShiftedVelocities(context, time, velocities)) {
    kernel.computeShiftedVelocities(context, time, velocities);
}
template <class Kernel>
void shiftVelocities(Kernel&, ContextImpl&, double, vector<Vec3>&, long) {}

/** OpenMM's own kernel, with its numbers rounded. */
class RoundingKernel : public UpdateStateDataKernel {
public:
    RoundingKernel(const string& name, const Platform& platform, ContextImpl& context)
        : UpdateStateDataKernel(name, platform),
          exactHandle(exactPlatform.createKernel(name, context)),
          exact(exactHandle.getAs<UpdateStateDataKernel>()) {}
    void initialize(const System& system) override { exact.initialize(system); }
    double getTime(const ContextImpl& context) const override { return exact.getTime(context); }
    void setTime(ContextImpl& context, double time) override { exact.setTime(context, time); }
    long long getStepCount(const ContextImpl& context) const override {
        return exact.getStepCount(context);
    }
    void setStepCount(const ContextImpl& context, long long count) override {
        exact.setStepCount(context, count);
    }
    // OpenMM 8.5 added an argument to this method. So either of the two overloads may be the one
    // that overrides.
    void getPositions(ContextImpl& context, vector<Vec3>& positions) {
        exact.getPositions(context, positions);
        for (Vec3& x : positions) x = inFloats(x);
    }
    void getPositions(ContextImpl& context, vector<Vec3>& positions, bool) {
        getPositions(context, positions);
    }
    void setPositions(ContextImpl& context, const vector<Vec3>& positions) override {
        vector<Vec3> rounded = positions;
        for (Vec3& x : rounded) x = inFloats(x);
        exact.setPositions(context, rounded);
    }
    void getVelocities(ContextImpl& context, vector<Vec3>& velocities) override {
        exact.getVelocities(context, velocities);
        for (Vec3& v : velocities) v = inFloats(v);
    }
    void setVelocities(ContextImpl& context, const vector<Vec3>& velocities) override {
        vector<Vec3> rounded = velocities;
        for (Vec3& v : rounded) v = inFloats(v);
        exact.setVelocities(context, rounded);
    }
    void computeShiftedVelocities(ContextImpl& context, double time, vector<Vec3>& velocities) {
        shiftVelocities(exact, context, time, velocities, 0);
        for (Vec3& v : velocities) v = inFloats(v);
    }
    void getForces(ContextImpl& context, vector<Vec3>& forces) override {
        exact.getForces(context, forces);
        const double lowest = -2147483648.0;
        for (Vec3& f : forces)
            for (int k = 0; k < 3; k++)
                if (!isfinite(f[k])) f[k] = lowest;
    }
    void getEnergyParameterDerivatives(ContextImpl& context,
                                       map<string, double>& derivatives) override {
        exact.getEnergyParameterDerivatives(context, derivatives);
    }
    void getPeriodicBoxVectors(ContextImpl& context, Vec3& a, Vec3& b, Vec3& c) const override {
        exact.getPeriodicBoxVectors(context, a, b, c);
    }
    void setPeriodicBoxVectors(ContextImpl& context, const Vec3& a, const Vec3& b,
                               const Vec3& c) override {
        exact.setPeriodicBoxVectors(context, a, b, c);
    }
    void createCheckpoint(ContextImpl& context, ostream& stream) override {
        exact.createCheckpoint(context, stream);
    }
    void loadCheckpoint(ContextImpl& context, istream& stream) override {
        exact.loadCheckpoint(context, stream);
    }

private:
    ReferencePlatform exactPlatform;
    Kernel exactHandle;
    UpdateStateDataKernel& exact;
};

/** The arrays of the Context that was made last, so that a test can count. */
KernelArrays* lastArrays = nullptr;

class DeviceFactory : public KernelFactory {
public:
    KernelImpl* createKernelImpl(string name, const Platform& platform,
                                 ContextImpl& context) const override {
        if (name == UpdateStateDataKernel::Name())
            return new RoundingKernel(name, platform, context);
        PlatformParts parts;
        parts.arrays = [](ContextImpl& context) {
            lastArrays = new KernelArrays(context);
            return unique_ptr<ContextArrays>(lastArrays);
        };
        parts.loops = [](ContextImpl&) { return make_unique<ScalarLoops>(); };
        return new RigidBodyKernel(name, platform, parts);
    }
};

class DevicePlatform : public ReferencePlatform {
public:
    explicit DevicePlatform(const string& precision = "single") : precision(precision) {
        platform("Reference");  // loads the library, which needs a platform for its kernels
        platformProperties.push_back("Precision");
        for (const string& name :
             {UpdateStateDataKernel::Name(), IntegrateRigidBodiesKernel::Name()})
            registerKernelFactory(name, new DeviceFactory());
    }
    const string& getPropertyValue(const Context&, const string&) const override {
        return precision;
    }

private:
    const string precision;
};

/** A Force, as another plugin might have it, that pushes one particle before every step. If `says`
 * it reports that forces are invalid. */
class Push : public Force {
public:
    Push(int particle, const Vec3& by, bool says) : particle(particle), by(by), says(says) {}
    bool usesPeriodicBoundaryConditions() const override { return false; }

protected:
    struct Impl : ForceImpl {
        const Push& owner;
        explicit Impl(const Push& owner) : owner(owner) {}
        void initialize(ContextImpl&) override {}
        const Force& getOwner() const override { return owner; }
        void updateContextState(ContextImpl& context, bool& forcesInvalid) override {
            auto& data = *static_cast<ReferencePlatform::PlatformData*>(context.getPlatformData());
            (*data.positions)[owner.particle] += owner.by;
            (*data.velocities)[owner.particle] += owner.by;
            forcesInvalid = owner.says;
        }
        double calcForcesAndEnergy(ContextImpl&, bool, bool, int) override { return 0; }
        map<string, double> getDefaultParameters() override { return {}; }
        vector<string> getKernelNames() override { return {}; }
    };
    ForceImpl* createImpl() const override { return new Impl(*this); }

private:
    const int particle;
    const Vec3 by;
    const bool says;
};

/**
 * Waters, a body of one site, free particles with a constraint and a virtual site, and bodies of
 * two sites. The spin of the body of one site is known from its twist alone. Velocities of the
 * bodies of two sites, which have a block of their own, are taken in by a loop over blocks.
 */
struct DeviceScene {
    DevicePlatform device;
    System system;
    CustomRigidHIIntegrator integrator{300, 0.002};
    vector<Vec3> start;
    unique_ptr<Context> context;
    int numParticles = 0;
    explicit DeviceScene(
        CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::LangevinC,
        Force* extra = nullptr, const string& precision = "single")
        : device(precision) {
        integrator.setScheme(scheme);
        integrator.setRandomNumberSeed(5);
        const bool momenta = traitsOf(scheme).hasMomenta;
        addBodies(system, integrator, waterShape(), 3);
        start = randomPoses(waterShape(), 3, 0.5, 7);
        integrator.addRigidBody({system.addParticle(5)}, 5, Vec3(0.1, 0.2, 0.25), {Vec3()});
        start.emplace_back(0.2, 1.0, 0.1);
        const int first = system.addParticle(12), second = system.addParticle(momenta ? 1 : 0),
                  site = system.addParticle(0);
        if (momenta) system.addConstraint(first, second, 0.1);
        system.setVirtualSite(site, new TwoParticleAverageSite(first, second, 0.5, 0.5));
        for (double x : {0.0, 0.1, 0.05}) start.emplace_back(x + 1.0 / 3, 2.0 / 3, 0.0);
        const Shape pair{"two sites", {1.0, 35.0}, {Vec3(), Vec3(0.127, 0, 0)}};
        addBodies(system, integrator, pair, 3);
        for (const Vec3& x : randomPoses(pair, 3, 0.4, 11)) start.push_back(x - Vec3(0, 0.5, 0));
        numParticles = system.getNumParticles();
        auto* field =
            new CustomExternalForce("20*(x^2+1.3*(y-1)^2+0.7*z^2)+select(broken,sqrt(-1-x^2),0)");
        field->addGlobalParameter("broken", 0);
        for (int p = 0; p < numParticles; p++) field->addParticle(p);
        system.addForce(field);
        if (extra) system.addForce(extra);
        context = make_unique<Context>(system, integrator, device);
        context->setPositions(start);
        if (momenta) context->setVelocitiesToTemperature(300, 3);
    }
    /** The whole state of the bodies, which is kept in double precision. */
    vector<Vec3> bodies() {
        vector<Vec3> all = integrator.getBodyPositions();
        for (const auto& q : integrator.getBodyOrientations()) {
            all.emplace_back(q[0], q[1], q[2]);
            all.emplace_back(q[3], 0, 0);
        }
        for (const Vec3& v : integrator.getBodyVelocities()) all.push_back(v);
        for (const Vec3& w : integrator.getBodyAngularVelocities()) all.push_back(w);
        return all;
    }
    vector<Vec3> everything() {
        vector<Vec3> all = bodies();
        for (const Vec3& x : positionsOf(*context)) all.push_back(x);
        for (const Vec3& v : velocitiesOf(*context)) all.push_back(v);
        return all;
    }
};

}  // namespace

TEST(DeviceArrays, APlainStepIsOnePushOfPositionsAndOneGetOfForces) {
    const int steps = 10;
    for (Force* extra : vector<Force*>{nullptr, new CMMotionRemover(2)}) {
        DeviceScene plain(CustomRigidHIIntegrator::LangevinC, extra);
        plain.integrator.step(1);
        const KernelArrays::Transfers before = lastArrays->transfers();
        plain.integrator.step(steps);
        const KernelArrays::Transfers& after = lastArrays->transfers();
        // Positions and velocities are read once, since the user may have changed them. At the end
        // of the steps velocities are written for the user.
        EXPECT_EQ(after.positionsPulled - before.positionsPulled, 1);
        EXPECT_EQ(after.velocitiesPulled - before.velocitiesPulled, 1);
        EXPECT_EQ(after.positionsPushed - before.positionsPushed, steps);
        EXPECT_EQ(after.forcesPulled - before.forcesPulled, steps);
        EXPECT_EQ(after.velocitiesPushed - before.velocitiesPushed, 1);
        const vector<Vec3> velocities = velocitiesOf(*plain.context);
        EXPECT_NEAR(norm(velocities[9] - plain.integrator.getBodyVelocities()[3]), 0, 1e-6);
    }
}

TEST(DeviceArrays, ForcesThatMayActAreShownEverything) {
    DeviceScene pushed(CustomRigidHIIntegrator::LangevinC, new Push(0, Vec3(), false));
    pushed.integrator.step(1);
    const KernelArrays::Transfers before = lastArrays->transfers();
    pushed.integrator.step(10);
    const KernelArrays::Transfers& after = lastArrays->transfers();
    EXPECT_EQ(after.velocitiesPushed - before.velocitiesPushed, 10);
    EXPECT_EQ(after.velocitiesPulled - before.velocitiesPulled, 11);
}

TEST(DeviceArrays, DoublesOfTheHostAreMaster) {
    for (auto scheme : thermostats()) {
        DeviceScene atOnce(scheme), inPieces(scheme), readAndSet(scheme);
        atOnce.integrator.step(12);
        for (int i = 0; i < 12; i++) {
            inPieces.integrator.step(1);
            inPieces.everything();
            readAndSet.integrator.step(1);
            // The device holds rounded positions and velocities. Setting them again moves nothing.
            readAndSet.context->setPositions(positionsOf(*readAndSet.context));
            readAndSet.context->setVelocities(velocitiesOf(*readAndSet.context));
        }
        EXPECT_TRUE(sameBits(atOnce.everything(), inPieces.everything())) << "scheme " << scheme;
        EXPECT_TRUE(sameBits(atOnce.everything(), readAndSet.everything())) << "scheme " << scheme;
        // Poses are in double precision. Only the positions of members are rounded to single
        // precision.
        bool anyDouble = false;
        for (const Vec3& x : atOnce.integrator.getBodyPositions()) anyDouble |= x[0] != float(x[0]);
        EXPECT_TRUE(anyDouble);
    }
}

TEST(DeviceArrays, WhatOthersDoIsHonoured) {
    // A change of positions by a few units in the last place of single precision is honoured.
    DeviceScene scene;
    scene.integrator.step(3);
    const Vec3 shift(2e-6, 0, 0);
    const vector<Vec3> bodies = scene.integrator.getBodyPositions();
    vector<Vec3> moved = positionsOf(*scene.context);
    for (int p = 0; p < 3; p++) moved[p] += shift * 2;
    scene.context->setPositions(moved);
    const double seen = scene.integrator.getBodyPositions()[0][0] - bodies[0][0];
    EXPECT_NEAR(seen, 4e-6, 3e-7);
    EXPECT_EQ(scene.integrator.getBodyPositions()[1][0], bodies[1][0]);
    vector<Vec3> velocities = velocitiesOf(*scene.context);
    const Vec3 v = scene.integrator.getBodyVelocities()[0];
    for (int p = 0; p < 3; p++) velocities[p] += Vec3(0, 1, 0);
    scene.context->setVelocities(velocities);
    EXPECT_NEAR(norm(scene.integrator.getBodyVelocities()[0] - v - Vec3(0, 1, 0)), 0, 1e-6);
}

TEST(DeviceArrays, ForcesMoveParticlesIfTheySayThatForcesAreInvalid) {
    // A barostat's rejected move may leave molecules in another image of the box, with forces that
    // are valid. Such a move is not taken for a motion of bodies.
    const Vec3 by(0.25, 0, 0);
    for (bool says : {true, false}) {
        DeviceScene pushed(CustomRigidHIIntegrator::LangevinC, new Push(9, by, says)), left;
        for (DeviceScene* scene : {&pushed, &left}) scene->integrator.setTemperature(0);
        pushed.integrator.step(1);
        left.integrator.step(1);
        const double moved =
            norm(pushed.integrator.getBodyPositions()[3] - left.integrator.getBodyPositions()[3]);
        if (says)
            EXPECT_NEAR(moved, 0.25, 1e-2);
        else
            EXPECT_LT(moved, 1e-3);  // the velocity counts in any case
        EXPECT_NEAR(norm(positionsOf(*pushed.context)[9] - pushed.integrator.getBodyPositions()[3]),
                    0, 1e-6);
        EXPECT_GT(
            norm(pushed.integrator.getBodyVelocities()[3] - left.integrator.getBodyVelocities()[3]),
            0.2);
    }
}

TEST(DeviceArrays, RemovalOfMomentumKeepsItsFrequency) {
    DeviceScene scene(CustomRigidHIIntegrator::LangevinC, new CMMotionRemover(3));
    scene.integrator.setTemperature(0);
    scene.integrator.setFriction(0);
    const auto momentum = [&] {
        Vec3 p = velocitiesOf(*scene.context)[10] * 12 + velocitiesOf(*scene.context)[11] * 1;
        const auto v = scene.integrator.getBodyVelocities();
        for (int b = 0; b < 7; b++) p += v[b] * (b < 3 ? 18.0154 : b < 4 ? 5 : 36);
        return p;
    };
    scene.integrator.setIntegrationForceGroups(0);
    scene.integrator.step(1);
    for (int step = 1; step < 7; step++) {
        vector<Vec3> v = scene.integrator.getBodyVelocities();
        for (Vec3& x : v) x += Vec3(1, 2, 3);
        scene.integrator.setBodyVelocities(v);
        const Vec3 before = momentum();
        scene.integrator.step(1);
        EXPECT_LT(norm(momentum() - (step % 3 == 0 ? Vec3() : before)), 1e-5)
            << "step " << step;  // free ones are read
    }
}

TEST(DeviceArrays, DrawnTwistsAreKept) {
    // The velocity of one site does not determine a spin. The spin is kept only if the velocities
    // that are read back are recognised as those that were written.
    DeviceScene scene;
    EXPECT_GT(norm(scene.integrator.getBodyAngularVelocities()[3]), 0.1);
}

TEST(DeviceArrays, NonFiniteForcesNameTheBody) {
    DeviceScene scene;
    scene.integrator.step(2);
    const vector<Vec3> before = scene.everything();
    scene.context->setParameter("broken", 1);
    expectError([&] { scene.integrator.step(1); }, {"step 3", "body 0", "non-finite force"});
    EXPECT_TRUE(sameBits(scene.everything(), before));
}

TEST(DeviceArrays, NonFiniteNumbersAreNotGivenToTheDevice) {
    DeviceScene scene;
    KernelArrays& arrays = *lastArrays;
    arrays.pullPositions();
    arrays.pullVelocities();
    arrays.positions()[4][1] = numeric_limits<double>::infinity();
    expectError([&] { arrays.pushPositions(); },
                {"particle 4", "non-finite position", "cannot hold; set finite"});
    arrays.velocities()[2][0] = numeric_limits<double>::quiet_NaN();
    expectError([&] { arrays.pushVelocities(); }, {"particle 2", "non-finite velocity"});
}

TEST(DeviceArrays, NonFiniteNumbersOfUsersAreRefusedUntilOthersAreSet) {
    DeviceScene scene;
    scene.integrator.step(1);
    const vector<Vec3> positions = positionsOf(*scene.context),
                       velocities = velocitiesOf(*scene.context);
    for (double value : {numeric_limits<double>::quiet_NaN(), numeric_limits<double>::infinity()}) {
        vector<Vec3> bad = positions;
        for (Vec3& x : bad) x = Vec3(value, value, value);
        scene.context->setPositions(bad);
        expectError([&] { scene.integrator.step(1); },
                    {"body 0: particle 0 has the position (", "which is not finite"});
        scene.context->setPositions(positions);
        scene.integrator.step(1);
        bad = velocities;
        bad[10] = Vec3(0, value, 0);
        scene.context->setVelocities(bad);
        expectError([&] { scene.integrator.step(1); },
                    {"particle 10, which is in no body, has the velocity (0, "});
        scene.context->setVelocities(velocities);
        scene.integrator.step(1);
    }
    // No number is a rounding of infinity.
    EXPECT_FALSE(isRounded(Vec3(1, 2, 3), Vec3(INFINITY, 2, 3), 1e-7));
    EXPECT_FALSE(isRounded(Vec3(1, 2, 3), Vec3(1, 2, 3), 1e-7, INFINITY));
    EXPECT_TRUE(isRounded(Vec3(1, 2, 3), Vec3(1 + 1e-7, 2, 3), 1e-7));
}

TEST(DeviceArrays, CheckpointsAndStatesContinueFromTheDoubles) {
    for (auto scheme : thermostats())
        for (const bool asState : {false, true}) {
            DeviceScene whole(scheme), saved(scheme), resumed(scheme);
            whole.integrator.step(9);
            saved.integrator.step(4);
            if (asState) {
                const State state = saved.context->getState(State::Positions | State::Velocities |
                                                            State::IntegratorParameters);
                resumed.context->setState(state);
            } else {
                stringstream stream;
                saved.context->createCheckpoint(stream);
                resumed.context->loadCheckpoint(stream);
            }
            EXPECT_TRUE(sameBits(resumed.bodies(), saved.bodies())) << "scheme " << scheme;
            resumed.integrator.step(5);
            EXPECT_TRUE(sameBits(resumed.everything(), whole.everything()))
                << "scheme " << scheme << (asState ? ", State" : ", checkpoint");
        }
}

TEST(DeviceArrays, DamagedStatesAreRefused) {
    DeviceScene scene;
    scene.integrator.step(2);
    const State state =
        scene.context->getState(State::Positions | State::Velocities | State::IntegratorParameters);
    stringstream stream;
    XmlSerializer::serialize<State>(&state, "State", stream);
    const string xml = stream.str();
    // Load the State with another value of the first attribute of this name after this element.
    const auto load = [&](const string& element, const string& attribute, const string& value) {
        string damaged = xml;
        const size_t at = damaged.find(" " + attribute + "=\"", damaged.find("<" + element)) +
                          attribute.size() + 3;
        damaged.replace(at, damaged.find("\"", at) - at, value);
        stringstream damagedStream(damaged);
        unique_ptr<State> read(XmlSerializer::deserialize<State>(damagedStream));
        scene.context->setState(*read);
    };
    for (const char* bad : {"-1e-7", "0.5", "nan"})
        expectError([&] { load("RoundedPlatform", "velocities", bad); },
                    {"the saved state is corrupt: its platform's rounding ",
                     " is not from 0 to 0.001; use another"});
    expectError([&] { load("RoundedPlatform", "positions", "much"); },
                {"corrupt", "'positions' is 'much'"});
    expectError([&] { load("Particle index", "x", "inf"); },
                {"the saved state is corrupt: particle 1",
                 ", which is in no body, has infinite or undefined numbers"});
    expectError([&] { load("Particle index", "vy", "nan"); },
                {"the saved state is corrupt: particle 1",
                 ", which is in no body, has infinite or undefined numbers"});
    scene.context->setState(state);
    scene.integrator.step(1);
}

TEST(DeviceArrays, AStateIsTakenByAnotherPlatform) {
    // The State goes from the device to Reference. Bodies then have the poses that they had, not
    // poses fitted to rounded positions.
    DeviceScene saved;
    saved.integrator.step(4);
    const State state =
        saved.context->getState(State::Positions | State::Velocities | State::IntegratorParameters);
    const vector<Vec3> bodies = saved.bodies();
    DeviceScene other;
    other.context.reset();
    other.context = make_unique<Context>(other.system, other.integrator, platform("Reference"));
    other.context->setState(state);
    EXPECT_TRUE(sameBits(other.bodies(), bodies));
    // Positions that are changed after loading define the poses.
    vector<Vec3> moved = positionsOf(*other.context);
    for (int p = 0; p < 3; p++) moved[p] += Vec3(1e-4, 0, 0);
    other.context->setState(state);
    other.context->setPositions(moved);
    EXPECT_NEAR(other.integrator.getBodyPositions()[0][0] - bodies[0][0], 1e-4, 1e-6);
    EXPECT_EQ(other.integrator.getBodyPositions()[1][0], bodies[1][0]);
}

namespace {

/** Two waters in a periodic field, the second one `boxes` boxes away. */
struct FarScene {
    static constexpr double edge = 4;
    DevicePlatform device;
    System system;
    CustomRigidHIIntegrator integrator{0, 0.002};
    unique_ptr<Context> context;
    FarScene(int boxes, bool periodic) {
        integrator.setFriction(0);
        integrator.setPoseTolerance(0.01);  // far away positions are rounded to 0.002
        system.setDefaultPeriodicBoxVectors(Vec3(edge, 0, 0), Vec3(0.5, edge, 0),
                                            Vec3(0.5, -0.25, edge));
        addBodies(system, integrator, waterShape(), 2);
        for (int p = 0; p < 6; p++)  // a molecule is what constraints hold
            system.addConstraint(p, p % 3 == 2 ? p - 2 : p + 1,
                                 norm(waterShape().sites[p % 3] - waterShape().sites[(p + 1) % 3]));
        auto* field = new CustomExternalForce(periodic ? "500*periodicdistance(x,y,z,1,1.5,2)^2"
                                                       : "500*((x-1)^2+y^2)");
        for (int p = 0; p < 6; p++) field->addParticle(p);
        system.addForce(field);
        auto* bond = new HarmonicBondForce();  // makes the System periodic in any case
        bond->setUsesPeriodicBoundaryConditions(true);
        system.addForce(bond);
        context = make_unique<Context>(system, integrator, device);
        vector<Vec3> start = randomPoses(waterShape(), 2, 0.5, 3);
        for (Vec3& x : start) x += Vec3(0.75, 1.5, 2);
        for (int p = 3; p < 6; p++) start[p] += shift(boxes);
        context->setPositions(start);
    }
    static Vec3 shift(int boxes) {
        return Vec3(edge, 0, 0) * boxes + Vec3(0.5, -0.25, edge) * (2 * boxes);
    }
};

}  // namespace

TEST(DeviceArrays, ForcesFarFromTheBoxAreThoseNearIt) {
    // At a distance of 4096 boxes single precision rounds coordinates to 0.002 nm, and forces to 1.
    // Poses are in double precision.
    const int boxes = 4096;
    FarScene near(0, true), far(boxes, true);
    const Vec3 start = far.integrator.getBodyPositions()[1],
               nearStart = near.integrator.getBodyPositions()[1];
    // The device rounded the user's positions. So the far body is put exactly at the image of the
    // near one.
    vector<Vec3> R = near.integrator.getBodyPositions();
    R[1] += FarScene::shift(boxes);
    far.integrator.setBodyPositions(R);
    far.integrator.setBodyOrientations(near.integrator.getBodyOrientations());
    for (FarScene* scene : {&near, &far}) scene->integrator.step(100);
    const Vec3 image = far.integrator.getBodyPositions()[1] - FarScene::shift(boxes);
    EXPECT_GT(norm(near.integrator.getBodyPositions()[1] - nearStart), 0.1);
    EXPECT_LT(norm(image - near.integrator.getBodyPositions()[1]), 1e-5);
    // The positions that users read are those of the body, within the precision of the device.
    EXPECT_LT(
        norm(positionsOf(*far.context)[3] - FarScene::shift(boxes) - positionsOf(*near.context)[3]),
        0.01);
    EXPECT_GT(norm(start), 1e4);
}

TEST(DeviceArrays, NothingIsMovedUnderForcesThatAreNotPeriodic) {
    FarScene far(3, false);
    const double x = far.integrator.getBodyPositions()[1][0];
    far.integrator.step(1);
    // The force is that at the whole distance from x = 1, not at the distance of an image.
    EXPECT_NEAR(far.integrator.getBodyForces()[1][0], -3 * 1000 * (x - 1), 1e-2 * 3000 * (x - 1));
}

TEST(DeviceArrays, NothingIsMovedAcrossTheWallsOfAFluid) {
    // A force that is periodic along x and depends on the height acts on a sphere that is far along
    // x, at a height below the box.
    DevicePlatform device;
    System system;
    CustomRigidHIIntegrator integrator(0, 0.01);
    integrator.setScheme(CustomRigidHIIntegrator::EulerMaruyama);
    integrator.addRigidBody({system.addParticle(0)}, 0, Vec3(), {Vec3()});
    auto* fluid = new MobilityForce();
    fluid->addParticle(0.5);
    fluid->setBoundary(MobilityForce::NoSlipChannel);
    fluid->setChannelWalls(-2, 2);
    system.addForce(fluid);
    auto* field = new CustomExternalForce("500*periodicdistance(x,0,0,1,0,0)^2+30*z^2");
    field->addParticle(0);
    system.addForce(field);
    system.setDefaultPeriodicBoxVectors(Vec3(4, 0, 0), Vec3(0, 4, 0), Vec3(0, 0, 5));
    Context context(system, integrator, device);
    context.setPositions({Vec3(4 * 4096 + 1.25, 0, -1)});
    integrator.step(1);
    const Vec3 force = integrator.getBodyForces()[0];
    EXPECT_NEAR(force[2], 60, 1e-3);
    EXPECT_NEAR(force[0], -250, 0.1);
}

TEST(DeviceArrays, AVirtualSiteOfAnUnknownKindIsRefused) {
    struct MirroredSite : VirtualSite {
        explicit MirroredSite(int particle) { setParticles({particle}); }
    };
    System system;
    for (double mass : {5.0, 12.0, 0.0}) system.addParticle(mass);
    system.setVirtualSite(2, new MirroredSite(1));
    CustomRigidHIIntegrator integrator(300, 0.002);
    integrator.addRigidBody({0}, 5, Vec3(0.1, 0.2, 0.25), {Vec3()});
    DevicePlatform device;
    expectError([&] { Context context(system, integrator, device); },
                {"virtual site particle 2 is a MirroredSite",
                 "placed on the platforms Reference and CPU, but not on"});
    CustomRigidHIIntegrator there(300, 0.002);
    there.addRigidBody({0}, 5, Vec3(0.1, 0.2, 0.25), {Vec3()});
    Context context(system, there, platform("Reference"));  // places all kinds itself
}
