// Replicas in groups, without momenta, at a wall. Each replica redoes its own steps into the wall.

#include <openmm/CustomExternalForce.h>
#include <openmm/VirtualSite.h>

#include <sstream>

#include "HydrodynamicSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "schemes/OverdampedSchemes.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;
using Scheme = RigidHI::Scheme;

struct Named {
    Scheme scheme;
    string name;
    bool forcesInBetween;
};
vector<Named> overdampedSchemes() {
    vector<Named> found;
    for (const RigidHIPlugin::SchemeTraits& traits : RigidHIPlugin::schemeTable)
        if (traits.isOverdamped())
            found.push_back({traits.scheme, traits.name,
                             RigidHIPlugin::overdampedScheme(traits.scheme).numStages() > 1});
    return found;
}
const vector<Named> schemes = overdampedSchemes();

/** Massless bodies of mobility about 1 above a wall at z = 0, under a weight of 1 on each particle.
 */
struct ReplicaScene : FluidScene {
    explicit ReplicaScene(Scheme scheme, double temperature = T1, double h = 0.3)
        : FluidScene(temperature, h) {
        integrator.setScheme(scheme);
        fluid->setBoundary(MobilityForce::NoSlipWall);
        fluid->setViscosity(1 / (6 * M_PI));
    }
    void addReplica(BodyKind kind, double height) {
        kind.mass = 0;
        kind.moments = Vec3();
        groups.push_back(groups.size());
        add(kind, Vec3(0, 0, height));
    }
    void addSpheres(int n, double height) {
        for (int i = 0; i < n; i++) addReplica(sphereKind(1), height);
    }
    void begin(int threadCount = 1, const string& energy = "z") {
        auto* weight = new CustomExternalForce(energy);
        for (int p = 0; p < system.getNumParticles(); p++)
            if (!system.isVirtualSite(p)) weight->addParticle(p, vector<double>());
        system.addForce(weight);
        fluid->setGroups(groups);
        start(testPlatform(), threadCount);
    }
    vector<int> groups;
};

}  // namespace

/**
 * A step of 64 replicas, each of which redoes one step in seven, costs hardly more than a step
 * without redone steps.
 */
TEST(OverdampedReplicas, AStepIsRedoneByThoseThatMust) {
    const int n = 64, steps = 100, limit = 20;
    for (const Named& s : schemes) {
        ReplicaScene scene(s.scheme);
        scene.addSpheres(n, 1.8);
        scene.integrator.setMaximumRejections(limit);
        scene.begin();
        int most = 0;
        for (int i = 0; i < steps; i++) {
            const int before = scene.integrator.getNumRejectedSteps();
            scene.integrator.step(1);
            most = max(most, scene.integrator.getNumRejectedSteps() - before);
            for (const Vec3& R : scene.integrator.getBodyPositions())
                ASSERT_GE(R[2], 1 - 1e-11) << s.name;
        }
        const double perReplica = scene.integrator.getNumRejectedSteps() / double(n * steps),
                     forces = scene.integrator.getStepStatistics().at("forceEvaluations") / steps;
        cout << s.name << ": " << perReplica << " of the replicas' steps were redone, " << most
             << " in one step; " << forces << " force evaluations a step" << endl;
        EXPECT_GT(perReplica, 0.05) << s.name;
        EXPECT_LT(perReplica, 0.35) << s.name;
        // The limit is that of one replica. Together the replicas redo more.
        EXPECT_GT(most, limit) << s.name;
        if (s.forcesInBetween) {
            EXPECT_LT(forces, 6) << s.name;
        } else {
            EXPECT_EQ(forces, 1) << s.name;
        }
    }
}

/**
 * The motion of one replica depends, bit for bit, neither on the steps that others redo nor on the
 * presence of others.
 */
TEST(OverdampedReplicas, AReplicaDoesNotFeelWhatOthersRedo) {
    const int n = 24, steps = 100;
    for (const Named& s : schemes) {
        // The scenes: all replicas near the wall; number 0 alone, with free particles that belong
        // to its group; all replicas far up except these and one more.
        ReplicaScene all(s.scheme, T1, 0.1), alone(s.scheme, T1, 0.1),
            othersHigh(s.scheme, T1, 0.1);
        int vsite = 0;
        for (ReplicaScene* scene : {&all, &alone, &othersHigh}) {
            scene->addReplica(boomerangKind(), 3);
            for (double y : {0.0, 3.0}) scene->addFree(0, 1, Vec3(6, y, 1.5));
            const vector<int>& free = scene->freeParticles;
            vsite = scene->system.addParticle(0);
            scene->system.setVirtualSite(vsite,
                                         new TwoParticleAverageSite(free[0], free[1], 0.25, 0.75));
            scene->fluid->addParticle(0);
            scene->positions.push_back(Vec3());
            if (scene != &alone) scene->addSpheres(n - 1, scene == &all ? 1.5 : 1000);
            scene->begin(1, "z + 0.02*z^2");
        }
        const int replica = n / 2;
        auto R = othersHigh.integrator.getBodyPositions();
        R[replica] = all.integrator.getBodyPositions()[replica];
        othersHigh.integrator.setBodyPositions(R);
        const vector<int>& free = all.freeParticles;
        for (int i = 0; i < steps; i++) {
            for (ReplicaScene* scene : {&all, &alone, &othersHigh}) scene->integrator.step(1);
            const auto x = positionsOf(*all.context), xAlone = positionsOf(*alone.context),
                       xHigh = positionsOf(*othersHigh.context);
            const vector<Vec3> ofFirst(x.begin(), x.begin() + xAlone.size());
            ASSERT_TRUE(sameBits(ofFirst, xAlone)) << s.name << " step " << i;
            ASSERT_TRUE(
                sameBits(ofFirst, vector<Vec3>(xHigh.begin(), xHigh.begin() + xAlone.size())))
                << s.name;
            ASSERT_TRUE(sameBits({all.integrator.getBodyPositions()[replica]},
                                 {othersHigh.integrator.getBodyPositions()[replica]}))
                << s.name << " step " << i;
            EXPECT_EQ(all.integrator.getBodyOrientations()[replica],
                      othersHigh.integrator.getBodyOrientations()[replica]);
            ASSERT_LT(norm(x[vsite] - (x[free[0]] * 0.25 + x[free[1]] * 0.75)),
                      readTolerance(1e-12, 10))
                << s.name;
        }
        // Forces are those of the positions at which the scheme evaluated them last, whether it
        // evaluated them again or not.
        EXPECT_TRUE(
            sameBits({all.integrator.getBodyForces()[0], all.integrator.getBodyTorques()[0]},
                     {alone.integrator.getBodyForces()[0], alone.integrator.getBodyTorques()[0]}))
            << s.name;
        EXPECT_TRUE(sameBits({all.integrator.getBodyForces()[replica]},
                             {othersHigh.integrator.getBodyForces()[replica]}))
            << s.name;
        // The test could fail, because number 0, this replica and many others were redone.
        const int byFirst = alone.integrator.getNumRejectedSteps(),
                  byTwo = othersHigh.integrator.getNumRejectedSteps();
        EXPECT_GT(byFirst, 3) << s.name;
        cout << s.name << ": redone by the first " << byFirst << ", with the replica " << byTwo
             << ", by all " << all.integrator.getNumRejectedSteps() << endl;
        EXPECT_GT(byTwo, byFirst) << s.name;
        EXPECT_GT(all.integrator.getNumRejectedSteps(), byTwo + 5 * n) << s.name;
    }
}

/** The mean height of many replicas is that of one replica, within the statistical error. */
TEST(OverdampedReplicas, HeightsAreThoseOfOneReplica) {
    const int n = 64, steps = 150, discard = 50;
    for (Scheme scheme : {RigidHI::RandomFiniteDifference, RigidHI::FixmanMidpoint,
                          RigidHI::TrapezoidalSlip, RigidHI::DriftCorrectorRFD}) {
        ReplicaScene many(scheme), one(scheme);
        many.addSpheres(n, 1.8);
        one.addSpheres(1, 1.8);
        one.integrator.setRandomNumberSeed(2);
        many.begin();
        one.begin();
        many.integrator.step(discard);
        one.integrator.step(discard);
        vector<double> heights(n, 0.0), blocks(n, 0.0), nearContact(n, 0.0),
            blocksNearContact(n, 0.0);
        for (int i = 0; i < steps; i++) {
            many.integrator.step(1);
            const auto R = many.integrator.getBodyPositions();
            for (int b = 0; b < n; b++) {
                heights[b] += R[b][2] / steps;
                nearContact[b] += (R[b][2] < 1.2) / double(steps);
            }
        }
        // Heights relax in about 4 time units, 13 steps, so blocks as long as the replicas' runs
        // are independent.
        for (int i = 0; i < n * steps; i++) {
            one.integrator.step(1);
            const double z = one.integrator.getBodyPositions()[0][2];
            blocks[i / steps] += z / steps;
            blocksNearContact[i / steps] += (z < 1.2) / double(steps);
        }
        const auto expectEqual = [](const string& what, const Estimate& a, const Estimate& b) {
            cout << a.mean << " and " << b.mean << ", ";
            expectMean(what, {a.mean - b.mean, hypot(a.error, b.error)}, 0);
        };
        expectEqual("difference of mean heights", estimate(heights), estimate(blocks));
        expectEqual("difference of times near contact", estimate(nearContact),
                    estimate(blocksNearContact));
        EXPECT_LT(estimate(heights).error, 0.15);
    }
}

/**
 * A step throws if new noise cannot help one of the replicas. All replicas are then restored, also
 * those that had finished the step.
 */
TEST(OverdampedReplicas, ARejectionThatDoesNotHelpRestoresAll) {
    for (const Named& s : schemes)
        for (bool onlyInBetween : {false, true}) {
            if (onlyInBetween && !s.forcesInBetween) continue;
            ReplicaScene scene(s.scheme, T1, 1e-3);
            scene.addSpheres(8, 3);
            // At intermediate positions the time is h/2 or h.
            auto* push = new CustomBodyForce("0", "0", onlyInBetween ? "-1e6*step(t-1e-4)" : "-1e6",
                                             "0", "0", "0");
            push->addBody(5, {});
            scene.system.addForce(push);
            scene.integrator.setMaximumRejections(4);
            scene.begin();
            const auto before = positionsOf(*scene.context);
            const auto q = scene.integrator.getBodyOrientations();
            expectError(
                [&] { scene.integrator.step(1); },
                {"step 1: ", "particle 5 (body 5)", "the step was redone 4 times in a row"});
            EXPECT_TRUE(sameBits(positionsOf(*scene.context), before)) << s.name;
            EXPECT_EQ(scene.integrator.getBodyOrientations(), q) << s.name;
            EXPECT_EQ(scene.integrator.getNumRejectedSteps(), 5) << s.name;
            // Only the step of this replica is redone.
            ReplicaScene calm(s.scheme, T1, 1e-3);
            calm.addSpheres(8, 3);
            calm.begin();
            calm.integrator.step(1);
            const auto statistics = scene.integrator.getStepStatistics();
            const double perSphere = calm.integrator.getStepStatistics().at("randomNumbers") / 8;
            EXPECT_EQ(statistics.at("randomNumbers"), perSphere * (8 + 4)) << s.name;
            // Forces at intermediate positions are evaluated again for each attempt that gets so
            // far.
            const bool atStart = s.name.substr(0, 5) != "Drift",
                       inBetween = onlyInBetween || !atStart;
            EXPECT_EQ(statistics.at("forceEvaluations"), atStart + 5 * inBetween) << s.name;
            // All replicas continue when this one is out of reach of the wall.
            auto R = scene.integrator.getBodyPositions();
            R[5] = Vec3(0, 0, 1e6);
            scene.integrator.setBodyPositions(R);
            scene.integrator.step(1);
        }
}

/**
 * Groups that are large enough for threads redo the same steps, bit for bit, with any number of
 * threads.
 */
TEST(OverdampedReplicas, ThreadsDoNotMatter) {
    for (const Named& s : schemes) {
        vector<Vec3> places[2];
        int rejections[2];
        for (int k = 0; k < 2; k++) {
            ReplicaScene scene(s.scheme);
            for (int i = 0; i < 16; i++) scene.addReplica(boomerangKind(), 3);
            scene.begin(k == 0 ? 1 : 4);
            scene.integrator.step(8);
            places[k] = positionsOf(*scene.context);
            rejections[k] = scene.integrator.getNumRejectedSteps();
        }
        EXPECT_TRUE(sameBits(places[0], places[1])) << s.name;
        EXPECT_EQ(rejections[0], rejections[1]) << s.name;
        EXPECT_GT(rejections[0], 5) << s.name;
    }
}

/** A resumed run equals the uninterrupted one, also with redone steps. */
TEST(OverdampedReplicas, ResumesBitForBit) {
    for (const Named& s : schemes) {
        ReplicaScene whole(s.scheme), part(s.scheme);
        for (ReplicaScene* scene : {&whole, &part}) {
            scene->addSpheres(12, 1.5);
            scene->begin();
        }
        whole.integrator.step(20);
        part.integrator.step(8);
        stringstream checkpoint;
        part.context->createCheckpoint(checkpoint);
        part.integrator.step(3);
        part.context->loadCheckpoint(checkpoint);
        part.integrator.step(12);
        EXPECT_TRUE(sameBits(positionsOf(*whole.context), positionsOf(*part.context))) << s.name;
        EXPECT_GT(whole.integrator.getNumRejectedSteps(), 10) << s.name;
    }
}

/**
 * The message says that the start is in the wall, also for schemes that need no mobility at the
 * start.
 */
TEST(OverdampedReplicas, AForbiddenStartIsNamed) {
    for (const Named& s : schemes)
        for (double temperature : {0.0, T1}) {
            ReplicaScene scene(s.scheme, temperature, 1e-4);
            scene.addSpheres(2, 3);
            scene.addSpheres(1, 0.9);
            scene.begin();
            const bool asksLater = temperature == 0 && s.name.substr(0, 5) == "Drift";
            expectError(
                [&] { scene.integrator.step(1); },
                {"particle 2 (body 2) has its centre 0.9 nm above the wall", "move it up",
                 asksLater
                     ? "step 1: the step starts at positions where the model has no mobility: "
                     : "MobilityForce: "});
        }
}
