// For every error that users may make with bodies and particles that are held, the call throws an
// OpenMMException that names object, value, bound and remedy.

#include <openmm/CMMotionRemover.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/MonteCarloAnisotropicBarostat.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/VirtualSite.h>

#include "HydrodynamicSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

/** Two bodies of two particles each, then two free particles, without a fluid. */
struct BadHeld : testing::Test {
    System system;
    CustomRigidHIIntegrator integrator{0, 0.001};
    BadHeld() {
        for (int i = 0; i < 6; i++) system.addParticle(1);
        integrator.addRigidBody({0, 1});
        integrator.addRigidBody({2, 3});
        integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    }
    void expectRefused(const vector<string>& fragments) {
        expectError([&] { Context context(system, integrator, testPlatform()); }, fragments);
    }
};

}  // namespace

TEST_F(BadHeld, Indices) {
    for (int bad : {-1, 2}) {
        expectError([&] { integrator.setBodyHeld(bad, true); },
                    {"setBodyHeld()", "body index " + to_string(bad) + " is out of range"});
        expectError([&] { integrator.getBodyHeld(bad); },
                    {"getBodyHeld()", "the integrator has 2 bodies"});
    }
    expectError([&] { integrator.setParticleHeld(-3, true); },
                {"setParticleHeld()", "the particle's index is -3; it must not be negative",
                 "give the index of a particle of the System"});
    expectError([&] { integrator.getParticleHeld(-3); }, {"getParticleHeld()", "index is -3"});
    expectError([&] { integrator.computeHoldingWrenches(); },
                {"computeHoldingWrenches()", "needs a Context"});
    expectError([&] { integrator.getHoldingWrenches(); },
                {"getHoldingWrenches()", "needs a Context"});
    expectError([&] { integrator.computeParticleHoldingForces(); },
                {"computeParticleHoldingForces()", "needs a Context"});
    expectError([&] { integrator.getParticleHoldingForces(); },
                {"getParticleHoldingForces()", "needs a Context"});
}

TEST_F(BadHeld, FlagsStayWithTheirBodies) {
    integrator.setBodyHeld(1, true);
    integrator.setRigidBodyParameters(1, {4, 5}, 1, Vec3(1, 1, 1), {Vec3(), Vec3(0.1, 0, 0)});
    integrator.addRigidBody({2});
    integrator.resetBodyGeometry();
    EXPECT_FALSE(integrator.getBodyHeld(0));
    EXPECT_TRUE(integrator.getBodyHeld(1));
    EXPECT_FALSE(integrator.getBodyHeld(2));
    const int before = integrator.getSettingsVersion();
    integrator.setBodyHeld(1, false);
    EXPECT_NE(integrator.getSettingsVersion(), before);
    EXPECT_FALSE(integrator.getBodyHeld(1));
}

TEST_F(BadHeld, ParticlesThatCannotBeHeld) {
    integrator.setParticleHeld(7, true);
    expectRefused({"particle 7 is held, but the System has 6 particles, numbered from 0",
                   "let it go by setParticleHeld(7, false)"});
    integrator.setParticleHeld(7, false);
    integrator.setParticleHeld(3, true);
    expectRefused({"particle 3 is held, but is in body 1; hold the body by setBodyHeld()"});
    integrator.setParticleHeld(3, false);
    integrator.setParticleHeld(6, true);
    system.addParticle(0);
    system.setVirtualSite(6, new TwoParticleAverageSite(4, 5, 0.5, 0.5));
    expectRefused({"particle 6 is held, but is a virtual site", "hold those particles"});
    integrator.setParticleHeld(6, false);
    system.addConstraint(0, 1, 0.1);
    system.addConstraint(4, 5, 0.1);
    for (int p : {4, 5}) {
        integrator.setParticleHeld(p, true);
        expectRefused({"constraint 1 ties particle " + to_string(p) +
                           ", which is held, to particle " + to_string(9 - p),
                       "make the molecule a body and hold the body, or let the particle go"});
        integrator.setParticleHeld(p, false);
    }
}

TEST_F(BadHeld, NothingThatMoves) {
    for (bool held : {true, false}) {
        for (int b : {0, 1}) integrator.setBodyHeld(b, held);
        for (int p : {4, 5}) integrator.setParticleHeld(p, held);
        if (held)
            expectRefused(
                {"everything is held (2 bodies and 2 free particles), so that nothing "
                 "would move",
                 "let something go by setBodyHeld(index, false) or "
                 "setParticleHeld(particle, false)"});
    }
    Context context(system, integrator, testPlatform());  // everything moves again
    // Massless particles do not move, whether they are held or not.
    System massless;
    for (int i = 0; i < 6; i++) massless.addParticle(i < 4 ? 1 : 0);
    CustomRigidHIIntegrator other(0, 0.001);
    other.addRigidBody({0, 1, 2, 3});
    other.setBodyHeld(0, true);
    expectError([&] { Context context(massless, other, testPlatform()); },
                {"everything is held (1 body and 0 free particles)"});
}

TEST_F(BadHeld, Barostats) {
    auto* bonds = new HarmonicBondForce();  // one molecule for each body
    bonds->setUsesPeriodicBoundaryConditions(true);
    bonds->addBond(0, 1, 0.1, 0);
    bonds->addBond(2, 3, 0.1, 0);
    system.addForce(bonds);
    const int index = system.addForce(new MonteCarloBarostat(1, 300));
    integrator.setBodyHeld(1, true);
    integrator.setParticleHeld(5, true);
    expectRefused({"body 1 is held, but the System has a MonteCarloBarostat, which would move it",
                   "remove the barostat, or let body 1 go"});
    integrator.setBodyHeld(1, false);
    expectRefused({"particle 5 is held, but the System has a MonteCarloBarostat"});
    system.removeForce(index);
    system.addForce(new MonteCarloAnisotropicBarostat(Vec3(1, 1, 1), 300));
    expectRefused({"particle 5 is held, but the System has a MonteCarloAnisotropicBarostat"});
}

TEST_F(BadHeld, RemovalOfMomentum) {
    system.addForce(new CMMotionRemover());
    integrator.setParticleHeld(4, true);
    expectRefused(
        {"particle 4 is held, so that momentum is not conserved, but the System has a "
         "CMMotionRemover",
         "removeCMMotion=False"});
}

TEST_F(BadHeld, NeedNeitherMassNorMobility) {
    for (int i : {2, 3, 4}) system.setParticleMass(i, 0);
    expectRefused({"body 1 has mass 0, but scheme LangevinC needs a positive mass"});
    integrator.setBodyHeld(1, true);
    EXPECT_NO_THROW(Context(system, integrator, testPlatform()));
    FluidScene scene;
    scene.add(sphereKind(0.5));
    scene.addFree(0, 0.4, Vec3(2, 0, 0));
    scene.addFree(1, 0, Vec3(4, 0, 0));
    scene.integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    expectError([&] { scene.start(testPlatform()); }, {"particle 1 has hydrodynamic radius"});
    scene.integrator.setScheme(CustomRigidHIIntegrator::FixmanMidpoint);
    expectError([&] { scene.start(testPlatform()); },
                {"particle 2 is in no body and has hydrodynamic radius 0"});
    for (auto scheme :
         {CustomRigidHIIntegrator::LangevinHI, CustomRigidHIIntegrator::FixmanMidpoint}) {
        scene.integrator.setScheme(scheme);
        for (int p : {1, 2}) scene.integrator.setParticleHeld(p, true);
        scene.context.reset();
        scene.start(testPlatform());
        EXPECT_NO_THROW(scene.integrator.step(2));
    }
}

TEST(HeldBetweenSteps, AreCheckedByTheNextStep) {
    FluidScene scene(300), twin(300);
    for (FluidScene* s : {&scene, &twin}) {
        s->add(sphereKind(0.5));
        s->add(sphereKind(0.5), Vec3(2, 0, 0));
        s->integrator.setScheme(CustomRigidHIIntegrator::TrapezoidalSlip);
        s->start(testPlatform());
        s->integrator.step(1);
    }
    EXPECT_EQ(scene.integrator.computeHoldingWrenches(), vector<double>(12));
    EXPECT_EQ(scene.integrator.getHoldingWrenches(), vector<double>(12));
    EXPECT_TRUE(sameBits(scene.integrator.computeParticleHoldingForces(), vector<Vec3>(2)));
    EXPECT_TRUE(sameBits(scene.integrator.getParticleHoldingForces(), vector<Vec3>(2)));
    // A body that is added now does not belong to the Context.
    scene.integrator.addRigidBody({2});
    scene.integrator.setBodyHeld(2, true);
    EXPECT_EQ(scene.integrator.computeHoldingWrenches(), vector<double>(12));
    scene.integrator.step(1);
    twin.integrator.step(1);
    EXPECT_EQ(scene.state(), twin.state());
    scene.integrator.setBodyHeld(0, true);
    scene.integrator.setBodyHeld(1, true);
    for (int attempt = 0; attempt < 2; attempt++)
        expectError([&] { scene.integrator.step(1); }, {"everything is held (2 bodies"});
    EXPECT_EQ(scene.state(), twin.state());
}
