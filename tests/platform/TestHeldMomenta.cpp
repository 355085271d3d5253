// Held bodies and free particles in schemes with momenta and under GradientThermostat: they stay in
// place to the last bit, and the others move as beside particles that cannot move. Units have kT =
// 1.

#include <openmm/HarmonicBondForce.h>
#include <openmm/VirtualSite.h>

#include <sstream>

#include "LangevinHISupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using Scheme = CustomRigidHIIntegrator::Scheme;
const auto A = CustomRigidHIIntegrator::LangevinA, B = CustomRigidHIIntegrator::LangevinB,
           C = CustomRigidHIIntegrator::LangevinC, HI = CustomRigidHIIntegrator::LangevinHI,
           gradient = CustomRigidHIIntegrator::GradientThermostat;

const set<int> heldBodies = {3, 4, 5};

/**
 * Six bodies of three kinds that springs tie to the next ones, and two free particles. The last
 * three bodies and the last free particle may be held.
 */
struct Springs : FluidScene {
    enum Held { Nothing, Some };

    explicit Springs(Scheme scheme, int threadCount = 1, Held held = Some, double h = 0.02)
        : FluidScene(T1, h) {
        mt19937 random(5);
        const vector<BodyKind> kinds = {boomerangKind(), markedSphere(0.6, 2, Vec3(0.5, 0.3, 0.4)),
                                        rodKind()};
        for (int b = 0; b < 6; b++)
            add(kinds[b % 3], Vec3(3.1 * (b % 3), 0.2 * b, 3.3 * (b / 3)),
                randomQuaternion(random));
        addFree(3, 0.3, Vec3(0, 4, 0));
        addFree(2, 0.4, Vec3(3, 4, 1));
        auto* springs = new HarmonicBondForce();
        for (int b = 0; b < 5; b++)
            springs->addBond(particles[b].back(), particles[b + 1][0], 2.5, 3);
        springs->addBond(freeParticles[0], freeParticles[1], 2, 4);
        springs->addBond(freeParticles[0], particles[4][1], 2, 2);
        system.addForce(springs);
        addField(system, "0.1*(x^2+y^2+z^2)+sin(2*y)");
        if (scheme != HI) removeFluid();
        integrator.setScheme(scheme);
        if (held == Some) hold();
        start(testPlatform(), threadCount);
        context->setVelocitiesToTemperature(T1, 7);
    }
    void hold(bool held = true) {
        for (int b : heldBodies) integrator.setBodyHeld(b, held);
        integrator.setParticleHeld(freeParticles[1], held);
    }
    vector<int> heldParticles() const {
        vector<int> result = {freeParticles[1]};
        for (int b : heldBodies)
            result.insert(result.end(), particles[b].begin(), particles[b].end());
        return result;
    }
};

void expectHeldAtRest(Springs& scene, const Snapshot& start, const string& what) {
    const Snapshot now(scene);
    for (int b : heldBodies) {
        EXPECT_EQ(now.R[b], start.R[b]) << what;
        EXPECT_EQ(now.q[b], start.q[b]) << what;
        EXPECT_EQ(now.V[b], Vec3()) << what;
        EXPECT_EQ(now.omega[b], Vec3()) << what;
    }
    for (int p : scene.heldParticles()) {
        EXPECT_EQ(now.x[p], start.x[p]) << what;
        EXPECT_EQ(now.v[p], Vec3()) << what;
    }
    for (int b = 0; b < 3; b++) EXPECT_GT(norm(now.R[b] - start.R[b]), 1e-3) << what;
    EXPECT_GT(norm(now.x[scene.freeParticles[0]] - start.x[scene.freeParticles[0]]), 1e-3) << what;
}

}  // namespace

TEST(HeldMomenta, WhatIsHeldStaysToTheLastBit) {
    for (Scheme scheme : {A, B, C, gradient, HI}) {
        Springs scene(scheme);
        const Snapshot start(scene);
        scene.integrator.step(50);
        expectHeldAtRest(scene, start, to_string(scheme));
        // Forces act on them: those of springs and of the field.
        for (int b : heldBodies) EXPECT_GT(norm(scene.integrator.getBodyForces()[b]), 0.01);
    }
}

TEST(HeldMomenta, AtWallsWithoutMatricesAndWithoutInteraction) {
    struct Case {
        MobilityForce::Model model;
        MobilityForce::Boundary boundary;
        MobilityForce::Solver solver;
    };
    for (const Case& fluid :
         {Case{MobilityForce::FreeDraining, MobilityForce::Unbounded, MobilityForce::Auto},
          Case{MobilityForce::RotnePragerYamakawa, MobilityForce::Unbounded,
               MobilityForce::MatrixFree},
          Case{MobilityForce::RotnePragerYamakawa, MobilityForce::NoSlipWall, MobilityForce::Auto},
          Case{MobilityForce::RotnePragerYamakawa, MobilityForce::NoSlipWall,
               MobilityForce::MatrixFree}}) {
        Springs scene(HI);
        scene.fluid->setModel(fluid.model);
        scene.fluid->setBoundary(fluid.boundary);
        scene.fluid->setWallHeight(-4);
        scene.fluid->setSolver(fluid.solver);
        scene.context.reset();
        scene.start(testPlatform());
        scene.context->setVelocitiesToTemperature(T1, 7);
        const Snapshot start(scene);
        scene.integrator.step(20);
        expectHeldAtRest(scene, start, to_string(fluid.model) + " " + to_string(fluid.solver));
    }
}

/** Held bodies have the same effect as particles without mass that are in no body. */
TEST(HeldMomenta, OthersMoveAsBesideParticlesThatCannotMove) {
    for (Scheme scheme : {A, B, C, gradient}) {
        Springs scene(scheme);
        // The same System, but for the bodies and particles that are held.
        FluidScene others(T1, 0.02);
        for (int b = 0; b < 3; b++) others.add(scene.bodies[b]);
        for (int b = 3; b < 6; b++)
            for (size_t i = 0; i < scene.bodies[b].sites.size(); i++) others.addFree(0, 0, Vec3());
        others.addFree(3, 0, Vec3());
        others.addFree(0, 0, Vec3());
        others.removeFluid();
        others.system.addForce(new HarmonicBondForce(
            dynamic_cast<const HarmonicBondForce&>(scene.system.getForce(0))));
        addField(others.system, "0.1*(x^2+y^2+z^2)+sin(2*y)");
        others.integrator.setScheme(scheme);
        others.start(testPlatform());
        others.context->setPositions(positionsOf(*scene.context));
        others.integrator.setBodyPositions([&] {
            auto R = scene.integrator.getBodyPositions();
            R.resize(3);
            return R;
        }());
        others.integrator.setBodyOrientations([&] {
            auto q = scene.integrator.getBodyOrientations();
            q.resize(3);
            return q;
        }());
        others.context->setVelocitiesToTemperature(T1, 7);
        const bool momenta = scheme != gradient;
        for (int check = 0; check < 3; check++) {
            const double tolerance = forceTolerance(1e-11, 10);
            const Snapshot a(scene), b(others);
            for (int i = 0; i < 3; i++) {
                EXPECT_LT(norm(a.R[i] - b.R[i]), tolerance);
                for (int k = 0; k < 4; k++) EXPECT_NEAR(a.q[i][k], b.q[i][k], tolerance);
            }
            EXPECT_LT(norm(a.x[scene.freeParticles[0]] - b.x[scene.freeParticles[0]]), tolerance);
            if (momenta) {
                for (int i = 0; i < 3; i++) {
                    EXPECT_LT(norm(a.V[i] - b.V[i]), tolerance);
                    EXPECT_LT(norm(a.omega[i] - b.omega[i]), tolerance);
                }
                const CustomRigidHIIntegrator &of = scene.integrator, &expected = others.integrator;
                EXPECT_NEAR(of.computeTranslationalKineticEnergy(),
                            expected.computeTranslationalKineticEnergy(), tolerance);
                EXPECT_GT(of.computeTranslationalKineticEnergy(), 0.1);
                EXPECT_LT(norm(of.computeRotationalKineticEnergies() -
                               expected.computeRotationalKineticEnergies()),
                          tolerance);
                EXPECT_NEAR(of.computeFreeParticleKineticEnergy(),
                            expected.computeFreeParticleKineticEnergy(), tolerance);
                EXPECT_NEAR(scene.context->getState(State::Energy).getKineticEnergy(),
                            others.context->getState(State::Energy).getKineticEnergy(), tolerance);
                EXPECT_NEAR(scene.integrator.computeSystemTemperature(),
                            others.integrator.computeSystemTemperature(), T1 * tolerance);
                const auto warm = of.computeMidStepTemperatures(),
                           expectedWarm = expected.computeMidStepTemperatures();
                EXPECT_EQ(warm.size(), expectedWarm.size());
                for (const auto& entry : expectedWarm)
                    EXPECT_NEAR(warm.at(entry.first), entry.second, T1 * tolerance) << entry.first;
            }
            EXPECT_EQ(scene.integrator.getDegreesOfFreedom(),
                      others.integrator.getDegreesOfFreedom());
            EXPECT_EQ(counter(scene, "randomNumbers"), counter(others, "randomNumbers"));
            scene.integrator.step(25);
            others.integrator.step(25);
        }
    }
}

TEST(HeldMomenta, HaveNoDegreesOfFreedom) {
    Springs scene(C, 1, Springs::Nothing);
    using Degrees = map<string, int>;
    const Degrees all = {{"translational", 18}, {"rotational1", 4}, {"rotational2", 6},
                         {"rotational3", 6},    {"free", 6},        {"removed", 0},
                         {"total", 40}},
                  some = {{"translational", 9}, {"rotational1", 2}, {"rotational2", 3},
                          {"rotational3", 3},   {"free", 3},        {"removed", 0},
                          {"total", 20}};
    EXPECT_EQ(scene.integrator.getDegreesOfFreedom(), all);
    const double energy = scene.context->getState(State::Energy).getKineticEnergy();
    // Flags count at once, before any step.
    scene.hold();
    EXPECT_EQ(scene.integrator.getDegreesOfFreedom(), some);
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    EXPECT_LT(scene.context->getState(State::Energy).getKineticEnergy(), 0.9 * energy);
    double byHand = 0;
    const auto V = integrator.getBodyVelocities();
    for (int b = 0; b < 3; b++) byHand += scene.bodies[b].mass * V[b].dot(V[b]) / 2;
    EXPECT_NEAR(integrator.computeTranslationalKineticEnergy(), byHand, 1e-12);
    const Vec3 v = velocitiesOf(*scene.context)[scene.freeParticles[0]];
    EXPECT_NEAR(integrator.computeFreeParticleKineticEnergy(), 1.5 * v.dot(v),
                readTolerance(1e-12, 1));
    EXPECT_NE(integrator.getEffects().at("rotation").find("2 bodies about three axes"),
              string::npos);
    EXPECT_NE(integrator.getEffects().at("rotation").find("1 linear body"), string::npos);
    scene.hold(false);
    EXPECT_EQ(scene.integrator.getDegreesOfFreedom(), all);
    // All bodies may be held where something else moves.
    for (int b = 0; b < 6; b++) scene.integrator.setBodyHeld(b, true);
    EXPECT_EQ(scene.integrator.getDegreesOfFreedom().at("total"), 6);
    const Snapshot before(scene);
    scene.integrator.step(5);
    EXPECT_EQ(Snapshot(scene).R, before.R);
    EXPECT_EQ(scene.integrator.computeTranslationalKineticEnergy(), 0);
    EXPECT_EQ(scene.integrator.computeMidStepTemperatures().count("translational"), 0);
    EXPECT_EQ(scene.integrator.getEffects().at("warnings"), "off: none");
}

TEST(HeldMomenta, FlagsMayChangeBetweenSteps) {
    for (Scheme scheme : {A, B, C, gradient, HI}) {
        // Held before the first step, or from the start.
        Springs later(scheme, 1, Springs::Nothing), fromStart(scheme);
        later.hold();
        later.integrator.step(20);
        fromStart.integrator.step(20);
        const string name = to_string(scheme);
        Snapshot(later).expectSameBits(Snapshot(fromStart), name);
        const Snapshot held(later);
        for (int p : later.heldParticles()) EXPECT_EQ(held.v[p], Vec3()) << name;
        // What is let go begins at rest, where it was held.
        later.hold(false);
        const Snapshot released(later);
        released.expectSameBits(held, name);
        later.integrator.step(20);
        const Snapshot moved(later);
        for (int b : heldBodies) {
            EXPECT_GT(norm(moved.R[b] - held.R[b]), 1e-3) << name;
            EXPECT_EQ(norm(moved.V[b]) > 0, scheme != gradient) << name;
        }
        const int p = later.freeParticles[1];
        EXPECT_GT(norm(moved.x[p] - held.x[p]), 1e-3) << name;
        // Held again: the momenta that they have then are lost.
        later.hold();
        later.integrator.step(1);
        const Snapshot again(later);
        for (int b : heldBodies) {
            EXPECT_EQ(again.R[b], moved.R[b]) << name;
            EXPECT_EQ(again.q[b], moved.q[b]) << name;
            EXPECT_EQ(again.V[b], Vec3()) << name;
        }
        for (int i : later.heldParticles())
            EXPECT_EQ(scheme == gradient ? Vec3() : again.v[i], Vec3()) << name;
    }
}

/** A flag that was set and cleared again before a step changes nothing except momenta. */
TEST(HeldMomenta, FlagsThatNothingSawAreNone) {
    Springs scene(C, 1, Springs::Nothing), other(C, 1, Springs::Nothing);
    scene.integrator.setBodyHeld(4, true);
    scene.integrator.setBodyHeld(4, false);
    scene.integrator.step(5);
    other.integrator.step(5);
    Snapshot(scene).expectSameBits(Snapshot(other), "taken back");
}

/** Without a fluid, holds balance forces alone, and steps do not record them. */
TEST(HeldMomenta, OnlyStepsInAFluidRecordHolds) {
    for (Scheme scheme : {A, B, C, gradient}) {
        Springs scene(scheme);
        scene.integrator.step(2);
        const auto now = scene.integrator.computeHoldingWrenches();
        EXPECT_GT(abs(now[6 * 4]), 1e-3);
        expectError([&] { scene.integrator.getHoldingWrenches(); },
                    {"getHoldingWrenches() is for schemes in a fluid, not for ",
                     "whose steps do not record what holds bodies; use the method that computes "
                     "it at the present poses"});
    }
    // At temperature 0 those of a short step are those of its velocities.
    Springs scene(HI, 1, Springs::Some, 1e-5);
    scene.integrator.setTemperature(0);
    scene.integrator.step(3);
    const auto last = scene.integrator.getHoldingWrenches(),
               now = scene.integrator.computeHoldingWrenches();
    const auto lastForces = scene.integrator.getParticleHoldingForces(),
               forces = scene.integrator.computeParticleHoldingForces();
    for (size_t i = 0; i < now.size(); i++) EXPECT_NEAR(last[i], now[i], 1e-3) << i;
    const int p = scene.freeParticles[1];
    EXPECT_GT(norm(forces[p]), 0.1);
    EXPECT_LT(norm(lastForces[p] - forces[p]), 1e-3);
}

TEST(HeldMomenta, VelocitiesOfWhatIsHeldAreAlwaysZero) {
    for (Scheme scheme : {A, B, C, HI}) {
        Springs scene(scheme), other(scheme);
        // setVelocitiesToTemperature() gives the others what it gives them anyhow.
        Springs all(scheme, 1, Springs::Nothing);
        const Snapshot drawn(scene), ofAll(all);
        for (int p : scene.heldParticles()) EXPECT_EQ(drawn.v[p], Vec3());
        for (int b = 0; b < 3; b++) {
            EXPECT_EQ(drawn.V[b], ofAll.V[b]);
            EXPECT_EQ(drawn.omega[b], ofAll.omega[b]);
        }
        EXPECT_EQ(drawn.v[scene.freeParticles[0]], ofAll.v[scene.freeParticles[0]]);
        // Velocities that users set for held bodies and particles have no effect.
        vector<Vec3> v = drawn.v;
        for (int p : scene.heldParticles()) v[p] = Vec3(1, 2, 3);
        scene.context->setVelocities(v);
        EXPECT_EQ(scene.integrator.getBodyVelocities()[4], Vec3());
        EXPECT_NEAR(scene.integrator.computeTranslationalKineticEnergy(),
                    other.integrator.computeTranslationalKineticEnergy(), readTolerance(1e-12, 1));
        EXPECT_NEAR(scene.integrator.computeFreeParticleKineticEnergy(),
                    other.integrator.computeFreeParticleKineticEnergy(), 0);
        vector<Vec3> V(6, Vec3(3, 2, 1));
        for (int b = 0; b < 3; b++) V[b] = drawn.V[b];
        scene.integrator.setBodyVelocities(V);
        V.assign(6, Vec3(3, 2, 1));
        for (int b = 0; b < 3; b++) V[b] = drawn.omega[b];
        scene.integrator.setBodyAngularVelocities(V);
        for (int b : heldBodies) {
            EXPECT_EQ(scene.integrator.getBodyVelocities()[b], Vec3());
            EXPECT_EQ(scene.integrator.getBodyAngularVelocities()[b], Vec3());
        }
        scene.integrator.step(10);
        other.integrator.step(10);
        for (int p : scene.heldParticles()) EXPECT_EQ(velocitiesOf(*scene.context)[p], Vec3());
        Snapshot(scene).expectNear(Snapshot(other), forceTolerance(1e-11, 10), to_string(scheme));
    }
}

TEST(HeldMomenta, MassesOfWhatIsHeldDoNotMatter) {
    // Masses of 0 are enough, of bodies that have the same places.
    for (Scheme scheme : {A, B, C, gradient, HI}) {
        vector<Snapshot> ends;
        for (double factor : {1.0, 1e6, 0.0}) {
            FluidScene scene(T1, 0.02);
            BodyKind kind = boomerangKind();
            scene.add(kind);
            kind.mass *= factor;
            kind.moments *= factor;
            scene.add(kind, Vec3(0, 3, 0), {{0.6, 0, 0.8, 0}});
            scene.addFree(2 * factor, 0.4, Vec3(0, 0, 4));
            if (scheme != HI) scene.removeFluid();
            addField(scene.system, "x^2+y^2+z^2");
            scene.integrator.setScheme(scheme);
            scene.integrator.setBodyHeld(1, true);
            scene.integrator.setParticleHeld(scene.freeParticles[0], true);
            scene.start(testPlatform());
            scene.context->setVelocitiesToTemperature(T1, 3);
            scene.integrator.step(20);
            ends.emplace_back(scene);
            EXPECT_TRUE(isfinite(scene.state().sum()));
            EXPECT_EQ(scene.integrator.getBodyVelocities()[1], Vec3());
            if (scheme != gradient) {
                EXPECT_EQ(scene.integrator.getDegreesOfFreedom().at("total"), 6);
            }
        }
        ends[1].expectSameBits(ends[0], to_string(scheme));
        // Without moments of inertia the inner axes have another order, and so poses other last
        // bits.
        ends[2].expectNear(ends[0], forceTolerance(1e-12, 1), to_string(scheme));
    }
}

TEST(HeldMomenta, ResumesBitForBit) {
    for (Scheme scheme : {A, B, C, gradient, HI})
        expectToResumeBitForBit<Springs>(
            [&](int threadCount) { return make_unique<Springs>(scheme, threadCount); },
            [](Springs& scene) { scene.integrator.step(7); }, 20);
}

TEST(HeldMomenta, ResumeAfterFlagsHaveChanged) {
    // A state that was saved with moving bodies goes on with held ones, and the other way round.
    for (bool first : {false, true}) {
        Springs saved(C, 1, first ? Springs::Some : Springs::Nothing),
            loaded(C, 1, first ? Springs::Nothing : Springs::Some);
        saved.integrator.step(5);
        stringstream checkpoint;
        saved.context->createCheckpoint(checkpoint);
        loaded.context->loadCheckpoint(checkpoint);
        saved.hold(!first);
        saved.integrator.step(10);
        loaded.integrator.step(10);
        Snapshot(loaded).expectSameBits(Snapshot(saved), to_string(first));
    }
}

TEST(HeldMomenta, VirtualSitesOfWhatIsHeldStay) {
    // A held water with a virtual site, and virtual sites of free particles, which OpenMM places.
    FluidScene scene(T1, 0.01);
    scene.removeFluid();
    scene.integrator.setScheme(C);
    const Shape water = waterShape();
    vector<Vec3> positions;
    for (int copy = 0; copy < 2; copy++) {
        const int p = scene.system.getNumParticles();
        const QuaternionArray q = {{0.5, 0.5, -0.5, 0.5}};
        for (int i = 0; i < 3; i++) {
            scene.system.addParticle(water.masses[i]);
            positions.push_back(Vec3(copy, 0.3, 0.2) + rotate(q, water.sites[i]));
        }
        scene.system.addParticle(0);
        scene.system.setVirtualSite(p + 3,
                                    new ThreeParticleAverageSite(p, p + 1, p + 2, 0.8, 0.1, 0.1));
        positions.push_back(positions[p] * 0.8 + (positions[p + 1] + positions[p + 2]) * 0.1);
        scene.integrator.addRigidBody({p, p + 1, p + 2, p + 3});
    }
    for (int i = 0; i < 2; i++) {
        scene.system.addParticle(5);
        positions.emplace_back(i, 2, 0);
    }
    scene.system.addParticle(0);
    scene.system.setVirtualSite(10, new TwoParticleAverageSite(8, 9, 0.3, 0.7));
    positions.push_back(positions[8] * 0.3 + positions[9] * 0.7);
    addField(scene.system, "3*(x^2+y^2+z^2)");
    scene.integrator.setBodyHeld(0, true);
    scene.integrator.setParticleHeld(8, true);
    scene.context = make_unique<Context>(scene.system, scene.integrator, testPlatform());
    scene.context->setPositions(positions);
    scene.context->setVelocitiesToTemperature(T1, 2);
    scene.integrator.step(1);
    const Snapshot first(scene);
    scene.integrator.step(30);
    const Snapshot last(scene);
    EXPECT_EQ(last.R[0], first.R[0]);
    EXPECT_EQ(last.q[0], first.q[0]);
    for (int p : {0, 1, 2, 3, 8}) {
        EXPECT_EQ(last.x[p], first.x[p]) << p;
        EXPECT_LT(norm(last.x[p] - positions[p]), readTolerance(1e-12, 1));
    }
    EXPECT_LT(norm(last.x[10] - (last.x[8] * 0.3 + last.x[9] * 0.7)), readTolerance(1e-12, 1));
    EXPECT_GT(norm(last.x[4] - first.x[4]), 1e-3);
}

TEST(HeldMomenta, StepsThatTheyWouldNotResolveAreNoWarnings) {
    struct Case {
        Scheme scheme;
        double h;
        string warning;
    };
    for (const Case& wrong : {Case{A, 0.3, "LangevinA breaks down"},
                              Case{A, 0.3, "LangevinA's step is not along the same axes"},
                              Case{C, 0.3, "does not resolve the rotation of 1 body"},
                              Case{gradient, 0.3, "turns at random by"},
                              Case{HI, 0.3, "relaxes: temperatures are right"}})
        for (bool held : {false, true}) {
            FluidScene scene(T1, wrong.h);
            scene.add(markedSphere(0.5, 2000, Vec3(500, 500, 500)));
            scene.add(
                {"light", 0.01, Vec3(0.01, 0.02, 0.025), {Vec3(), Vec3(0.2, 0.1, 0)}, {0.5, 0}},
                Vec3(4, 0, 0));
            if (wrong.scheme != HI) scene.removeFluid();
            scene.integrator.setScheme(wrong.scheme);
            scene.integrator.setBodyFriction(1, 200, 300);
            scene.integrator.setGradientRotationalRelaxationTime(0.01);
            scene.integrator.setBodyHeld(1, held);
            scene.start(testPlatform());
            scene.integrator.step(1);
            const string found = scene.integrator.getEffects().at("warnings");
            if (held) {
                EXPECT_EQ(found, "off: none");
            } else {
                EXPECT_NE(found.find(wrong.warning), string::npos) << wrong.warning << "\n"
                                                                   << found;
            }
        }
}

TEST(HeldMomenta, TheWatchExpectsNoHeatOfWhatIsHeld) {
    // One of ten bodies moves. A window of the watch has 4000 steps, and the first one begins after
    // as many.
    FluidScene scene(T1, 0.02);
    scene.removeFluid();
    for (int b = 0; b < 10; b++) {
        scene.system.addParticle(1);
        scene.positions.emplace_back(b, 0, 0);
        scene.integrator.addRigidBody({b}, 1, Vec3(0.3, 0.4, 0.5), {Vec3()});
        scene.integrator.setBodyHeld(b, b > 0);
    }
    addField(scene.system, "x^2+y^2+100*z+z^2");
    scene.integrator.setScheme(C);
    scene.integrator.setFriction(20);
    scene.integrator.setRotationalFriction(20);
    scene.context = make_unique<Context>(scene.system, scene.integrator, testPlatform());
    scene.context->setPositions(scene.positions);
    scene.context->setVelocitiesToTemperature(T1, 3);
    scene.integrator.step(20000);
    EXPECT_EQ(scene.integrator.getEffects().at("warnings"), "off: none");
}

// ---- The friction of a fluid beside what is held ----

namespace {

/** The rows of bodies and free particles that are not held, in a FluidScene. */
vector<int> movableRows(const FluidScene& scene) {
    vector<int> rows;
    const int n = scene.bodies.size();
    for (int b = 0; b < n; b++)
        for (int k = 0; k < 6 && !scene.integrator.getBodyHeld(b); k++) rows.push_back(6 * b + k);
    for (size_t i = 0; i < scene.freeParticles.size(); i++)
        for (int k = 0; k < 3 && !scene.integrator.getParticleHeld(scene.freeParticles[i]); k++)
            rows.push_back(6 * n + 3 * i + k);
    return rows;
}

MatrixXd block(const MatrixXd& m, const vector<int>& rows, const vector<int>& columns) {
    MatrixXd result(rows.size(), columns.size());
    for (size_t i = 0; i < rows.size(); i++)
        for (size_t k = 0; k < columns.size(); k++) result(i, k) = m(rows[i], columns[k]);
    return result;
}

/** Multiblobs and spheres, or spheres only, about 2.5 apart; the first of each is held. */
void addMixture(FluidScene& scene, bool multiblobs) {
    mt19937 random(3);
    int place = 0;
    const auto put = [&](const BodyKind& kind) {
        scene.add(kind, Vec3(2.6 * (place % 2), 2.4 * (place / 2 % 2), 2.7 * (place / 4)),
                  randomQuaternion(random));
        place++;
    };
    for (int copy = 0; copy < 2; copy++) {
        if (multiblobs) put(boomerangKind());
        put(markedSphere(0.6, 2, Vec3(0.5, 0.3, 0.4)));
        if (!multiblobs) put(markedSphere(0.4, 1.5, Vec3(0.2, 0.25, 0.3)));
    }
    for (double y : {-2.0, 5.0}) scene.addFree(1.3, 0.35, Vec3(0.3, y, 1));
    scene.integrator.setBodyHeld(0, true);
    scene.integrator.setBodyHeld(1, true);
    scene.integrator.setParticleHeld(scene.freeParticles[0], true);
}

}  // namespace

/** V(h) = exp(-h I^-1 xi_ff) V(0), with the free block of the friction of all. */
TEST(HeldMomenta, OneStepInAFluidDecaysByTheFreeBlockOfTheFriction) {
    for (bool multiblobs : {false, true})
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
            for (double h : {1e-3, 0.05, 1.0}) {
                FluidScene scene(0, h);
                addMixture(scene, multiblobs);
                scene.fluid->setSolver(solver);
                scene.fluid->setSolverTolerance(1e-10);
                scene.start(testPlatform());
                const vector<int> rows = movableRows(scene);
                ASSERT_EQ(rows.size(), 15u);
                const MatrixXd friction = block(scene.expected().friction, rows, rows);
                MatrixXd inertia = MatrixXd::Zero(30, 30);
                const auto q = scene.integrator.getBodyOrientations();
                for (int b = 0; b < 4; b++) {
                    const BodyKind& kind = scene.bodies[b];
                    inertia.block<3, 3>(6 * b, 6 * b) = kind.mass * Matrix3d::Identity();
                    const Matrix3d turn = rotationOf(q[b]);
                    inertia.block<3, 3>(6 * b + 3, 6 * b + 3) =
                        turn * toEigen(kind.moments).asDiagonal() * turn.transpose();
                }
                for (int k = 24; k < 30; k++) inertia(k, k) = 1.3;
                // xi x = rate I x
                const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> modes(
                    friction, block(inertia, rows, rows));
                const double size = 1e-6;
                VectorXd start = VectorXd::Zero(30), expected(15);
                mt19937 random(4);
                normal_distribution<double> normal;
                for (int row : rows) start[row] = size * normal(random);
                expected = modes.eigenvectors() *
                           (modes.eigenvalues() * -h).array().exp().matrix().asDiagonal() *
                           modes.eigenvectors().inverse() * block(start, rows, {0});
                setTwists(scene, start, {Vec3(), toVec3(start.tail<3>())});
                scene.integrator.step(1);
                const VectorXd after = twistsOf(scene);
                const double tolerance = readTolerance(1e-7, 1);
                EXPECT_LT((block(after, rows, {0}) - expected).norm() / start.norm(), tolerance)
                    << multiblobs << " " << solver << " " << h;
                EXPECT_EQ(after.head<12>().norm(), 0);
            }
}

/**
 * A uniform flow past obstacles: spheres reach the force-free velocities, xi_ff (V - v) = xi_fo v.
 */
TEST(HeldMomenta, AFlowPastWhatIsHeldDrivesTheOthers) {
    FluidScene scene(0, 1.0);
    addMixture(scene, false);
    const double size = 1e-7;
    scene.fluid->setBackgroundFlow(Vec3(size, 0.5 * size, -size), vector<double>(9, 0.0));
    scene.start(testPlatform());
    const vector<int> rows = movableRows(scene);
    vector<int> obstacles;
    for (int k = 0; k < 30; k++)
        if (find(rows.begin(), rows.end(), k) == rows.end()) obstacles.push_back(k);
    VectorXd flow = VectorXd::Zero(30);
    for (int row : {0, 6, 12, 18, 24, 27}) flow.segment<3>(row) << size, 0.5 * size, -size;
    const MatrixXd friction = scene.expected().friction;
    const VectorXd expected = block(flow, rows, {0}) + block(friction, rows, rows)
                                                           .ldlt()
                                                           .solve(block(friction, rows, obstacles) *
                                                                  block(flow, obstacles, {0}));
    EXPECT_GT((expected - block(flow, rows, {0})).norm(), 0.1 * size);
    scene.integrator.step(20);
    EXPECT_LT((block(twistsOf(scene), rows, {0}) - expected).norm(), 1e-4 * expected.norm());
}

TEST(HeldMomenta, EquipartitionOfTheOthersInAFluid) {
    FluidScene scene(T1, 0.05);
    addMixture(scene, true);
    addField(scene.system, "0.5*(x^2+y^2+z^2)");
    scene.start(testPlatform());
    scene.context->setVelocitiesToTemperature(T1, 5);
    scene.integrator.step(50);
    vector<double> translational, rotational, free;
    const int samples = 40, steps = 300;
    for (int i = 0; i < samples; i++) {
        double sums[3] = {0, 0, 0};
        for (int k = 0; k < steps; k++) {
            scene.integrator.step(1);
            const Vec3 axes = scene.integrator.computeRotationalKineticEnergies();
            sums[0] += scene.integrator.computeTranslationalKineticEnergy();
            sums[1] += axes[0] + axes[1] + axes[2];
            sums[2] += scene.integrator.computeFreeParticleKineticEnergy();
        }
        translational.push_back(sums[0] / steps);
        rotational.push_back(sums[1] / steps);
        free.push_back(sums[2] / steps);
    }
    expectMean("translation of 2 bodies beside held ones", estimate(translational), 3);
    expectMean("rotation of 2 bodies beside held ones", estimate(rotational), 3);
    expectMean("a free particle beside held ones", estimate(free), 1.5);
}
