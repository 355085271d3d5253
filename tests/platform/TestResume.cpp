// Runs resume exactly and are deterministic, bit for bit on Reference. On CPU this holds for the
// plugin's own arithmetic with any number of threads. (One thread evaluates the forces of these
// Systems there.)

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/NonbondedForce.h>
#include <openmm/VirtualSite.h>
#include <openmm/serialization/XmlSerializer.h>

#include <sstream>

#include "TestSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

/** Bodies of all kinds, a virtual site, free particles, a constrained free molecule. */
struct Scene {
    System system;
    vector<Vec3> positions;
    vector<vector<int>> implicitBodies;

    explicit Scene(bool withNonbonded) {
        auto* field = new CustomExternalForce("20*(x^2+y^2+z^2)+sin(5*x)*y");
        auto* bonds = new HarmonicBondForce();
        auto* nonbonded = new NonbondedForce();
        mt19937 generator(17);
        int place = 0;
        vector<Shape> shapes = allShapes();
        shapes.resize(8);
        for (const Shape& shape : shapes)
            for (int copy = 0; copy < 3; copy++) {
                vector<int> particles;
                const QuaternionArray q = randomQuaternion(generator);
                for (size_t i = 0; i < shape.sites.size(); i++) {
                    particles.push_back(system.addParticle(shape.masses[i]));
                    positions.push_back(rotate(q, shape.sites[i]) + origin(place));
                }
                if (shape.name == "water") {
                    particles.push_back(system.addParticle(0));
                    const int p = particles[0];
                    system.setVirtualSite(particles.back(), new ThreeParticleAverageSite(
                                                                p, p + 1, p + 2, 0.8, 0.1, 0.1));
                    positions.push_back(positions[p] * 0.8 + positions[p + 1] * 0.1 +
                                        positions[p + 2] * 0.1);
                }
                implicitBodies.push_back(particles);
                place++;
            }
        explicitParticle = system.addParticle(5.0);
        positions.push_back(origin(place++));
        for (int i = 0; i < 4; i++) {  // free ions
            system.addParticle(23.0);
            positions.push_back(origin(place++));
        }
        // A free three-atom molecule with one constraint, one bond, and a virtual site.
        const int p = system.addParticle(12.0);
        system.addParticle(1.0);
        system.addParticle(16.0);
        system.addParticle(0.0);
        for (const Vec3& x : {Vec3(), Vec3(0.1, 0, 0), Vec3(0, 0.12, 0), Vec3(0.05, 0, 0)})
            positions.push_back(origin(place) + x);
        system.addConstraint(p, p + 1, 0.1);
        bonds->addBond(p, p + 2, 0.12, 1000);
        system.setVirtualSite(p + 3, new TwoParticleAverageSite(p, p + 1, 0.5, 0.5));
        for (int i = 0; i < system.getNumParticles(); i++) {
            if (!system.isVirtualSite(i)) field->addParticle(i, vector<double>());
            nonbonded->addParticle(i % 2 ? 0.1 : -0.1, 0.1, 0.1);
        }
        for (const auto& body : implicitBodies)
            for (size_t a = 0; a < body.size(); a++)
                for (size_t b = 0; b < a; b++) nonbonded->addException(body[a], body[b], 0, 1, 0);
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++) nonbonded->addException(p + a, p + b, 0, 1, 0);
        system.addForce(field);
        system.addForce(bonds);
        system.addForce(new CMMotionRemover());
        if (withNonbonded)
            system.addForce(nonbonded);
        else
            delete nonbonded;
    }
    static Vec3 origin(int place) {
        return Vec3(1.3 * (place % 4), 1.3 * (place / 4 % 4), 1.3 * (place / 16));
    }
    unique_ptr<CustomRigidHIIntegrator> makeIntegrator(int seed) const {
        auto integrator = make_unique<CustomRigidHIIntegrator>(300, 0.002);
        for (const auto& body : implicitBodies) integrator->addRigidBody(body);
        integrator->addRigidBody({explicitParticle}, 5.0, Vec3(0.2, 0.1, 0.15), {Vec3()});
        integrator->setRandomNumberSeed(seed);
        return integrator;
    }
    int explicitParticle;
};

struct Snapshot {
    vector<Vec3> positions, velocities, bodyPositions, angularVelocities;
    vector<QuaternionArray> orientations;
};

Snapshot snapshot(Context& context, CustomRigidHIIntegrator& integrator) {
    return {positionsOf(context), velocitiesOf(context), integrator.getBodyPositions(),
            integrator.getBodyAngularVelocities(), integrator.getBodyOrientations()};
}

void expectSame(const Snapshot& a, const Snapshot& b, const string& what) {
    EXPECT_TRUE(sameBits(a.positions, b.positions)) << what;
    EXPECT_TRUE(sameBits(a.velocities, b.velocities)) << what;
    EXPECT_TRUE(sameBits(a.bodyPositions, b.bodyPositions)) << what;
    EXPECT_TRUE(sameBits(a.angularVelocities, b.angularVelocities)) << what;
    EXPECT_EQ(a.orientations, b.orientations) << what;
}

/** A Scene in a Context, warmed up and ready to be saved. */
struct Trajectory {
    unique_ptr<CustomRigidHIIntegrator> integrator;
    unique_ptr<Context> context;
    Trajectory(Scene& scene, int seed, int threadCount, bool start,
               CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::LangevinC)
        : integrator(scene.makeIntegrator(seed)) {
        integrator->setScheme(scheme);
        context = make_unique<Context>(scene.system, *integrator, testPlatform(),
                                       threads(testPlatformName(), threadCount));
        if (!start) return;
        context->setPositions(scene.positions);
        context->setVelocitiesToTemperature(300, 9);
    }
    Snapshot now() {
        Snapshot found = snapshot(*context, *integrator);
        // The velocities of virtual sites mean nothing, and OpenMM's constraints on devices change
        // them.
        for (int p = 0; onDevice() && p < context->getSystem().getNumParticles(); p++)
            if (context->getSystem().isVirtualSite(p)) found.velocities[p] = Vec3();
        return found;
    }
};

}  // namespace

TEST(Resume, TwentyStepsAreTenAndTen) {
    Scene scene(!onCpu());
    for (auto scheme : thermostatsWithMomenta()) {
        Trajectory one(scene, 5, 2, true, scheme), two(scene, 5, 2, true, scheme);
        one.integrator->step(20);
        two.integrator->step(10);
        two.context->getState(State::Energy | State::Forces |
                              State::Positions);  // reading the state changes nothing
        two.now();
        two.integrator->step(10);
        expectSame(one.now(), two.now(), "scheme " + to_string(scheme));
    }
}

TEST(Resume, CheckpointsAndStatesContinueTheRunAtAnyStep) {
    Scene scene(!onCpu());
    mt19937 generator(1);
    for (auto scheme : thermostatsWithMomenta()) {
        Trajectory whole(scene, 0, 2, true, scheme);  // seed 0: a fresh seed, which must be saved
        for (int part = 0; part < 4; part++) {
            whole.integrator->step(1 + generator() % 7);
            stringstream checkpoint;
            whole.context->createCheckpoint(checkpoint);
            const State state =
                whole.context->getState(State::Positions | State::Velocities | State::Parameters |
                                        State::IntegratorParameters);
            stringstream xml;
            XmlSerializer::serialize<State>(&state, "State", xml);
            whole.integrator->step(9);
            const Snapshot expected = whole.now();

            Trajectory fromCheckpoint(scene, 0, 2, false, scheme);
            fromCheckpoint.context->loadCheckpoint(checkpoint);
            fromCheckpoint.integrator->step(9);
            expectSame(expected, fromCheckpoint.now(), "checkpoint");

            Trajectory fromState(scene, 77, 2, false, scheme);
            fromState.context->setState(state);
            fromState.integrator->step(9);
            expectSame(expected, fromState.now(), "State");

            unique_ptr<State> copy(XmlSerializer::deserialize<State>(xml));
            // Load into a Context that has taken other steps.
            Trajectory fromXml(scene, 123, 2, true, scheme);
            fromXml.integrator->step(3);
            fromXml.context->setState(*copy);
            fromXml.integrator->step(9);
            expectSame(expected, fromXml.now(), "State from XML");
        }
    }
}

TEST(Resume, TheGradientThermostatContinuesToo) {
    Scene scene(!onCpu());
    scene.system.removeForce(2);  // CMMotionRemover
    // The gradient thermostat refuses constraints, so the molecule has none.
    scene.system.removeConstraint(0);
    Trajectory whole(scene, 3, 2, false, CustomRigidHIIntegrator::GradientThermostat);
    whole.context->setPositions(scene.positions);
    whole.integrator->step(7);
    stringstream checkpoint;
    whole.context->createCheckpoint(checkpoint);
    whole.integrator->step(9);
    Trajectory resumed(scene, 4, 1, false, CustomRigidHIIntegrator::GradientThermostat);
    resumed.context->loadCheckpoint(checkpoint);
    resumed.integrator->step(9);
    expectSame(whole.now(), resumed.now(), "gradient");
}

TEST(Resume, AStateSavedBeforeMembersWerePutBackContinuesTheSame) {
    SKIP_ON_DEVICES(
        "poses of members off their places are fitted anew, to places that were rounded, and "
        "momenta "
        "then follow from rounded velocities");
    Scene scene(!onCpu());
    Trajectory whole(scene, 5, 1, true);
    whole.integrator->step(3);
    vector<Vec3> moved = positionsOf(*whole.context);
    moved[0] += Vec3(1e-4, 0, 0);  // within the tolerance
    whole.context->setPositions(moved);
    stringstream checkpoint;
    whole.context->createCheckpoint(checkpoint);
    whole.integrator->step(5);
    Trajectory resumed(scene, 6, 1, false);
    resumed.context->loadCheckpoint(checkpoint);
    resumed.integrator->step(5);
    expectSame(whole.now(), resumed.now(), "moved");
}

TEST(Resume, PositionsSetAfterLoadingAreNotIgnored) {
    Scene scene(!onCpu());
    Trajectory run(scene, 5, 1, true);
    stringstream checkpoint;
    run.context->createCheckpoint(checkpoint);
    Trajectory resumed(scene, 6, 1, false);
    resumed.context->loadCheckpoint(checkpoint);
    vector<Vec3> shifted = scene.positions;
    for (Vec3& x : shifted) x += Vec3(0, 0, 0.5);
    const double before = resumed.integrator->getBodyPositions()[0][2];
    resumed.context->setPositions(shifted);
    EXPECT_NEAR(resumed.integrator->getBodyPositions()[0][2], before + 0.5,
                readTolerance(1e-12, 1));
}

TEST(Resume, TheNumberOfThreadsDoesNotMatter) {
    if (!onCpu()) GTEST_SKIP() << "one thread on Reference";
    // There are enough bodies for threads to share the work.
    System system;
    const Shape water = waterShape();
    const int copies = 3300;
    CustomRigidHIIntegrator unused(300, 0.002);
    addBodies(system, unused, water, copies);
    auto* field = new CustomExternalForce("x^2+y^2+z^2");
    for (int i = 0; i < system.getNumParticles(); i++) field->addParticle(i, vector<double>());
    system.addForce(field);
    vector<Vec3> positions = randomPoses(water, copies, 0.01, 1);
    for (int i = 0; i < 13000; i++) {  // free particles
        field->addParticle(system.addParticle(5), vector<double>());
        positions.push_back(Vec3(0.001 * i, 1, 0));
    }
    vector<Snapshot> results;
    for (int count : {1, 2, 3}) {
        CustomRigidHIIntegrator integrator(300, 0.002);
        for (int c = 0; c < copies; c++) integrator.addRigidBody({3 * c, 3 * c + 1, 3 * c + 2});
        integrator.setRandomNumberSeed(8);
        Context context(system, integrator, testPlatform(), threads("CPU", count));
        context.setPositions(positions);
        context.setVelocitiesToTemperature(300, 2);
        integrator.step(25);
        results.push_back(snapshot(context, integrator));
    }
    expectSame(results[0], results[1], "1 and 2 threads");
    expectSame(results[0], results[2], "1 and 3 threads");
}

TEST(Resume, ContextsSteppedInTurnDoNotDisturbEachOther) {
    Scene scene(!onCpu());
    Trajectory alone(scene, 5, 1, true), a(scene, 5, 1, true), b(scene, 6, 1, true);
    alone.integrator->step(10);
    for (int i = 0; i < 10; i++) {
        a.integrator->step(1);
        b.integrator->step(2);
    }
    expectSame(alone.now(), a.now(), "in turn");
}

TEST(Resume, ReinitializePreservesTheState) {
    Scene scene(!onCpu());
    Trajectory alone(scene, 5, 1, true), again(scene, 5, 1, true);
    alone.integrator->step(10);
    again.integrator->step(4);
    again.context->reinitialize(true);
    again.integrator->step(6);
    expectSame(alone.now(), again.now(), "reinitialize");
    again.context->reinitialize();
    again.context->setPositions(scene.positions);
    again.integrator->step(1);
}

TEST(Resume, ASeedThatIsSetTakesEffectAtTheNextStep) {
    // Without nonbonded forces, so that equal noise gives equal bits on every platform.
    Scene scene(false);
    for (auto scheme : thermostatsWithMomenta()) {
        const string what = "scheme " + to_string(scheme);
        Trajectory run(scene, 5, 1, true, scheme);
        run.integrator->step(3);
        stringstream saved;
        run.context->createCheckpoint(saved);
        const auto load = [&] {
            saved.clear();
            saved.seekg(0);
            run.context->loadCheckpoint(saved);
        };
        run.integrator->step(4);
        const Snapshot uninterrupted = run.now();
        // Runs from one checkpoint: a seed that is set before is replaced, one that is set after
        // counts.
        vector<Snapshot> ends;
        for (int seed : {11, 12, 13, 11, 5}) {
            run.integrator->setRandomNumberSeed(99);
            EXPECT_EQ(run.integrator->getRandomNumberSeed(), 99) << what;
            load();
            EXPECT_EQ(run.integrator->getRandomNumberSeed(), 5) << what;
            EXPECT_EQ(run.integrator->getRandomNumberSeedAsSet(), 99) << what;
            run.integrator->setRandomNumberSeed(seed);
            EXPECT_EQ(run.integrator->getRandomNumberSeed(), seed) << what;
            run.integrator->step(4);
            ends.push_back(run.now());
        }
        for (int i = 0; i < 3; i++) {
            EXPECT_FALSE(sameBits(ends[i].positions, ends[(i + 1) % 3].positions)) << what;
            EXPECT_FALSE(sameBits(ends[i].bodyPositions, ends[(i + 1) % 3].bodyPositions)) << what;
        }
        expectSame(ends[0], ends[3], what + ": the same seed again");
        expectSame(ends[4], uninterrupted, what + ": the seed that was in use");
        // The new seed is saved, too, and a Context that begins with it has the same noise.
        load();
        run.integrator->setRandomNumberSeed(12);
        stringstream changed;
        run.context->createCheckpoint(changed);
        Trajectory other(scene, 77, 1, false, scheme);
        other.context->loadCheckpoint(changed);
        EXPECT_EQ(other.integrator->getRandomNumberSeed(), 12) << what;
        other.integrator->step(4);
        expectSame(ends[1], other.now(), what + ": a checkpoint with the new seed");
    }
}

TEST(Resume, SeedZeroIsAFreshSeedForEachContextAndEachCall) {
    Scene scene(false);
    Trajectory run(scene, 0, 1, true), other(scene, 0, 1, true);
    const int drawn = run.integrator->getRandomNumberSeed();
    EXPECT_NE(drawn, 0);
    EXPECT_NE(drawn, other.integrator->getRandomNumberSeed());  // false alarm: 2^-32
    EXPECT_EQ(run.integrator->getRandomNumberSeedAsSet(), 0);
    stringstream xml;
    XmlSerializer::serialize<Integrator>(run.integrator.get(), "Integrator", xml);
    unique_ptr<Integrator> copy(XmlSerializer::deserialize<Integrator>(xml));
    EXPECT_EQ(dynamic_cast<CustomRigidHIIntegrator&>(*copy).getRandomNumberSeed(), 0)
        << "a copy would have the noise of this Context";
    run.integrator->setRandomNumberSeed(0);
    EXPECT_NE(run.integrator->getRandomNumberSeed(), 0);
    EXPECT_NE(run.integrator->getRandomNumberSeed(), drawn);  // false alarm: 2^-32
    // Another run with the seed that was drawn is the same run.
    const int inUse = other.integrator->getRandomNumberSeed();
    Trajectory again(scene, inUse, 1, true);
    EXPECT_EQ(again.integrator->getRandomNumberSeed(), inUse);
    other.integrator->step(3);
    again.integrator->step(3);
    expectSame(other.now(), again.now(), "the seed that was drawn");
    // reinitialize() begins with the seed as it was set, unless it preserves the state.
    again.integrator->setRandomNumberSeed(8);
    again.context->reinitialize(true);
    EXPECT_EQ(again.integrator->getRandomNumberSeed(), 8);
    again.context.reset();
    EXPECT_EQ(again.integrator->getRandomNumberSeed(), 8) << "without a Context";
}

TEST(Resume, ForeignAndDamagedStatesAreRefused) {
    Scene scene(false);
    Trajectory run(scene, 5, 1, true);
    run.integrator->step(1);
    stringstream good;
    run.context->createCheckpoint(good);
    const string bytes = good.str();
    auto load = [&](const string& data) {
        stringstream stream(data);
        Trajectory other(scene, 5, 1, false);
        other.context->loadCheckpoint(stream);
    };
    load(bytes);
    expectError([&] { load(bytes.substr(0, bytes.size() - 100)); },
                {"checkpoint is corrupt", "ends too early"});
    string damaged = bytes;
    damaged[bytes.size() - 50] ^= 1;
    expectError([&] { load(damaged); }, {"check sum does not match", "use another checkpoint"});
    const size_t mark = bytes.rfind("RIGIDHI3");
    ASSERT_NE(mark, string::npos);
    damaged = bytes;
    damaged[mark] = 'X';
    expectError([&] { load(damaged); }, {"not written by this integrator"});
    damaged = bytes;
    for (int i = 0; i < 8; i++) damaged[mark + 8 + i] = '\xff';
    expectError([&] { load(damaged); }, {"header is damaged"});

    // A State of an integrator with other bodies.
    Scene smaller(false);
    smaller.implicitBodies.pop_back();
    Trajectory other(smaller, 5, 1, true);
    const State state =
        other.context->getState(State::Positions | State::Velocities | State::IntegratorParameters);
    expectError([&] { run.context->setState(state); }, {"the saved state has", "bodies"});
}
