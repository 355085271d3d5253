// Under StokesianDynamics overlapping spheres have no mobility. A step that ends in overlap is
// therefore redone, or throws.

#include <openmm/CustomExternalForce.h>

#include <iostream>
#include <sstream>

#include "TestSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;
using RigidHIPlugin::CustomBodyForce;
using RigidHIPlugin::MobilityForce;

namespace {

/** Two unit spheres on the x axis at a gap, pushed together by a force. */
struct Pair {
    Pair(double gap, double push, double temperature, double h, double minimumGap = 0,
         double mass = 1, int seed = 3)
        : integrator(temperature, h), force(new MobilityForce()) {
        auto* pushing = new CustomExternalForce("side*push*x");
        pushing->addPerParticleParameter("side");
        pushing->addGlobalParameter("push", push);
        for (int i = 0; i < 2; i++) {
            integrator.addRigidBody({system.addParticle(mass)}, mass, Vec3(0.4, 0.4, 0.4) * mass,
                                    {Vec3()});
            force->addParticle(1);
            pushing->addParticle(i, {i == 0 ? -1.0 : 1.0});
        }
        force->setModel(MobilityForce::StokesianDynamics);
        force->setViscosity(1 / (4 * M_PI));
        force->setMinimumGap(minimumGap);
        system.addForce(force);
        system.addForce(pushing);
        integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
        integrator.setRandomNumberSeed(seed);
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 1));
        context->setPositions({Vec3(-1 - gap / 2, 0, 0), Vec3(1 + gap / 2, 0, 0)});
    }
    double gap() {
        const vector<Vec3> x = positionsOf(*context);
        return norm(x[1] - x[0]) - 2;
    }
    System system;
    CustomRigidHIIntegrator integrator;
    MobilityForce* force;
    unique_ptr<Context> context;
};

}  // namespace

TEST(Overlap, AnOverlappingStartIsRefusedWithThePairNamed) {
    Pair pair(-0.1, 0, 300, 0.01);
    expectError([&] { pair.integrator.step(1); },
                {"particle 0 (body 0)", "particle 1 (body 1)", "overlap",
                 readTolerance(0, 1) < 1e-12 ? "1.9 nm" : "1.8999999"});
    expectError([&] { pair.force->getMobilityInContext(*pair.context); },
                {"overlap", "setMinimumGap"});
    EXPECT_NEAR(pair.gap(), -0.1, readTolerance(1e-12, 1));
}

TEST(Overlap, StepsAreRedoneWithNewNoiseAndCounted) {
    // At kT = 1, unit mass and this step a free flight is a tenth of a radius, so overlaps are
    // common.
    Pair pair(0.3, 20, 1 / boltzmann, 0.1);
    int rejected = 0;
    for (int i = 0; i < 3000; i++) {
        pair.integrator.step(1);
        ASSERT_GT(pair.gap(), 0);
    }
    rejected = pair.integrator.getNumRejectedSteps();
    EXPECT_GT(rejected, 10);
    EXPECT_EQ(pair.integrator.getStepStatistics()["steps"], 3000);
    cout << rejected << " of 3000 steps were redone" << endl;
}

TEST(Overlap, RejectionsResumeBitForBit) {
    Pair whole(0.3, 5, 1 / boltzmann, 0.1), resumed(0.3, 5, 1 / boltzmann, 0.1);
    whole.integrator.step(500);
    stringstream saved;
    whole.context->createCheckpoint(saved);
    whole.integrator.step(500);
    ASSERT_GT(whole.integrator.getNumRejectedSteps(), 0);
    resumed.context->loadCheckpoint(saved);
    resumed.integrator.step(500);
    EXPECT_TRUE(sameBits(positionsOf(*whole.context), positionsOf(*resumed.context)));
    EXPECT_TRUE(sameBits(velocitiesOf(*whole.context), velocitiesOf(*resumed.context)));
}

TEST(Overlap, WithoutNoiseOrPatienceItIsAnError) {
    // The spheres are heavy and on a collision course. The friction does not stop them within a
    // step.
    Pair cold(0.5, 0, 0, 0.1, 0, 1000);
    cold.integrator.setBodyVelocities({Vec3(3, 0, 0), Vec3(-3, 0, 0)});
    const auto collide = [](Pair& pair) { pair.integrator.step(50); };
    expectError([&] { collide(cold); }, {"step ", "overlap", "temperature 0", "smaller step"});
    EXPECT_GT(cold.gap(), 0);
    Pair warm(0.5, 0, 300, 0.1, 0, 1000);
    warm.integrator.setBodyVelocities({Vec3(3, 0, 0), Vec3(-3, 0, 0)});
    warm.integrator.setMaximumRejections(7);
    expectError([&] { collide(warm); }, {"7 times in a row", "setMaximumRejections()"});
    EXPECT_GT(warm.gap(), 0);
    EXPECT_EQ(warm.integrator.getNumRejectedSteps(), 8);
    expectError([&] { warm.integrator.setMaximumRejections(-1); },
                {"setMaximumRejections()", "-1"});
}

TEST(Overlap, AMinimumGapLetsSpheresThrough) {
    Pair pair(0.3, 5, 1 / boltzmann, 0.1, 1e-3);
    pair.integrator.step(1000);
    EXPECT_EQ(pair.integrator.getNumRejectedSteps(), 0);
    Pair start(-0.2, 0, 300, 0.01, 1e-2);
    start.integrator.step(10);
    EXPECT_TRUE(isfinite(start.gap()));
}

TEST(Overlap, LooksAheadWithTheForcesThatTheNextStepStartsWith) {
    // There is a driving force c v with c h/2m = 0.5. The force that is predicted for the end of a
    // step is less than that of the velocity reached, with which the next step starts. A look ahead
    // with the predicted force accepts gaps of 0.202 to 0.208. These overlap at the next mid-step,
    // where no noise can help and nothing is redone.
    int refused = 0;
    for (double gap = 0.1; gap < 0.4; gap += 0.002) {
        Pair pair(gap, 0, 0, 0.1, 0, 1000);
        auto* drive = new CustomBodyForce("c*vx", "0", "0", "0", "0", "0");
        drive->addGlobalParameter("c", 10000);
        for (int i = 0; i < 2; i++) drive->addBody(i, {});
        pair.system.addForce(drive);
        pair.context->reinitialize(true);
        pair.integrator.setBodyVelocities({Vec3(0.3, 0, 0), Vec3(-0.3, 0, 0)});
        try {
            pair.integrator.step(3);
        } catch (const OpenMMException& e) {
            EXPECT_NE(string(e.what()).find("at temperature 0 there is no noise"), string::npos)
                << gap << ": " << e.what();
            refused++;
        }
    }
    EXPECT_GT(refused, 50);
}
