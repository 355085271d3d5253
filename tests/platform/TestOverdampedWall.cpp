// Schemes without momenta at a wall by the public API: starts in contact, steps into the wall,
// exact heights, long bodies and many bodies near the wall.

#include <openmm/CustomBondForce.h>

#include "OverdampedSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::traitsOf;
using namespace std;

TEST(OverdampedWall, StartsInContactWithTheWall) {
    for (const Named& s : schemes) {
        for (bool crossing : {false, true}) {
            OverdampedScene scene(s.scheme, T1, 1e-3);
            scene.fluid->setBoundary(MobilityForce::NoSlipWall);
            scene.integrator.setWallRejection(crossing ? RigidHI::Crossing : RigidHI::Overlap);
            scene.addMassless(sphereKind(0.7), Vec3(0, 0, 0.7));
            scene.addMassless(rodKind(), Vec3(3, 0, 0.5), {{sqrt(0.5), 0, sqrt(0.5), 0}});
            scene.addMassless(sphereKind(0.7), Vec3(0, 1.2, 0.7));
            scene.start(testPlatform());
            scene.integrator.step(200);
            const auto x = positionsOf(*scene.context);
            for (int i = 0; i < scene.system.getNumParticles(); i++)
                EXPECT_GE(x[i][2], crossing ? 0 : scene.fluid->getParticleRadius(i) * (1 - 1e-12))
                    << s.name;
            if (!crossing) {
                EXPECT_GT(scene.integrator.getNumRejectedSteps(), 0) << s.name;
            }
        }
    }
}

namespace {

/** Delong's boomerang above a wall, with lengths in radii of its blobs, kT = 1, and a weight of g *
 * 0.18. */
void addBoomerang(OverdampedScene& scene, double g) {
    const double spacing = 0.3 / 0.324557;
    BodyKind kind = {"boomerang of 15 blobs", 0, Vec3(), {}, vector<double>(15, 1.0)};
    for (int i = 7; i > 0; i--) kind.sites.push_back(Vec3(i * spacing, 0, 0));
    for (int i = 0; i < 8; i++) kind.sites.push_back(Vec3(0, i * spacing, 0));
    scene.fluid->setBoundary(MobilityForce::NoSlipWall);
    scene.fluid->setViscosity(1 / (6 * M_PI));
    scene.addMassless(kind, Vec3(0, 0, 4), OverdampedScene::randomTurn(3));
    scene.addWells(to_string(0.18 * g / 15) + "*z + 23.08/max(z-1, 1e-9)*exp(-2*(z-1))");
}

/** Expects that no member is below contact with the wall, and that distances between members are
 * unchanged. */
void expectIntact(OverdampedScene& scene, const vector<Vec3>& before, double tolerance) {
    const auto x = positionsOf(*scene.context);
    double lowest = INFINITY, largest = 0;
    for (size_t i = 0; i < x.size(); i++) {
        lowest = min(lowest, x[i][2]);
        for (size_t j = 0; j < i; j++)
            largest = max(largest, abs(norm(x[i] - x[j]) - norm(before[i] - before[j])));
    }
    EXPECT_GE(lowest, 1 - readTolerance(1e-12, 1));
    EXPECT_LT(largest, readTolerance(tolerance, 10));
}

}  // namespace

/**
 * A weight of g = 100 presses the boomerang onto the wall, with steps ten times too long for the
 * repulsion. The body stays rigid and above the wall.
 */
TEST(OverdampedWall, StrongGravity) {
    for (const Named& s : schemes) {
        if (s.scheme == RigidHI::DriftCorrectorFD)
            continue;  // as DriftCorrectorRFD, but at three times the cost
        OverdampedScene scene(s.scheme, T1, 0.05);
        addBoomerang(scene, 100);
        scene.integrator.setMaximumRejections(10000);
        scene.start(testPlatform());
        const auto before = positionsOf(*scene.context);
        scene.integrator.step(1000);
        expectIntact(scene, before, 1e-11);
        EXPECT_LT(scene.integrator.getBodyPositions()[0][2], 12) << s.name;
    }
}

/** After ten million steps the shape and the unit quaternion are still exact. */
TEST(OverdampedWall, LongTenMillionStepsOfABoomerang) {
    OverdampedScene scene(RigidHI::RandomFiniteDifference, T1, 0.1);
    addBoomerang(scene, 1);
    scene.start(testPlatform());
    const auto before = positionsOf(*scene.context);
    double height = 0;
    const int samples = 10000;
    for (int i = 0; i < samples; i++) {
        scene.integrator.step(1000);
        height += scene.integrator.getBodyPositions()[0][2] / samples;
    }
    expectIntact(scene, before, 1e-11);
    const auto q = scene.integrator.getBodyOrientations()[0];
    EXPECT_NEAR(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], 1, 1e-14);
    cout << "mean height of the cross point " << height << ", exact 10.854; rejected "
         << scene.integrator.getNumRejectedSteps() << endl;
    EXPECT_NEAR(height, 10.854, 0.2);
}

TEST(OverdampedWall, StepsThroughTheWallWithoutNoiseAreAnError) {
    for (const Named& s : schemes) {
        OverdampedScene scene(s.scheme, 0, 100);
        scene.fluid->setBoundary(MobilityForce::NoSlipWall);
        scene.addMassless(sphereKind(0.7), Vec3(0, 0, 1.5));
        scene.addWells("5*z");
        scene.start(testPlatform());
        const VectorXd before = scene.state();
        expectError([&] { scene.integrator.step(1); },
                    {"particle 0 (body 0)", "at temperature 0 there is no noise"});
        EXPECT_EQ((scene.state() - before).norm(), 0) << s.name;  // the last good state stays
    }
}

/**
 * The message names a bad start, not a bad step, also for schemes that compute no mobility at the
 * start.
 */
TEST(OverdampedWall, StartsBelowTheWallAreNamed) {
    for (const Named& s : schemes)
        for (double temperature : {0.0, T1}) {
            OverdampedScene scene(s.scheme, temperature, 1e-3);
            scene.fluid->setBoundary(MobilityForce::NoSlipWall);
            scene.addMassless(sphereKind(0.7), Vec3(0, 0, 2));
            scene.addMassless(boomerangKind(), Vec3(5, 0, 0.3));
            scene.start(testPlatform());
            string message;
            try {
                scene.integrator.step(1);
            } catch (const exception& e) {
                message = e.what();
            }
            SCOPED_TRACE(s.name + ": " + message);
            EXPECT_NE(message.find("(body 1) has its centre"), string::npos);
            EXPECT_EQ(message.find("redoing the step cannot help"), string::npos);
            EXPECT_EQ(message.find("times in a row"), string::npos);
        }
}

TEST(OverdampedWall, StiffStepsEndInAnErrorThatNamesTheBody) {
    OverdampedScene scene(RigidHI::RandomFiniteDifference, T1, 50);
    scene.fluid->setBoundary(MobilityForce::NoSlipWall);
    scene.integrator.setMaximumRejections(5);
    scene.addMassless(boomerangKind(), Vec3(0, 0, 8));
    scene.addWells("500*z");
    scene.start(testPlatform());
    expectError([&] { scene.integrator.step(1); },
                {"(body 0)", "the step was redone 5 times in a row", "take a smaller step"});
}

namespace {

/**
 * Estimate the mean of a quantity of replicas, each a group of its own, from every tenth step.
 *
 * @param bodies  of a replica, which the scene already has
 * @param of      gives the quantity from the positions of all bodies and the first of the replica
 */
Estimate meanOverReplicas(OverdampedScene& scene, int bodies, int discard, int steps,
                          const function<double(const vector<Vec3>& R, int first)>& of) {
    const int replicas = scene.bodies.size() / bodies, every = 10;
    vector<int> groups;
    for (size_t b = 0; b < scene.bodies.size(); b++) groups.push_back(b / bodies);
    scene.fluid->setGroups(groups);
    scene.fluid->setViscosity(1 / (6 * M_PI));
    scene.start(testPlatform());
    scene.integrator.step(discard);
    vector<double> means(replicas, 0.0);
    for (int i = 0; i < steps / every; i++) {
        scene.integrator.step(every);
        const auto R = scene.integrator.getBodyPositions();
        for (int k = 0; k < replicas; k++) means[k] += of(R, bodies * k) / (steps / every);
    }
    return estimate(means);
}

/**
 * With the drift, the exact mean height of a sphere above a wall is that of the density exp(-U/kT);
 * without the drift, that of exp(-U/kT)/mu_perp.
 */
void checkHeights(const vector<pair<Scheme, RigidHI::NoiseLaw>>& cases, bool lubricated = false) {
    const double a = 1, g = 1, repulsion = 10, decay = 3;
    double sum[2] = {0, 0}, first[2] = {0, 0};
    for (double z = a + 0.0005; z < 25; z += 0.001) {
        const double u = a / z, weight = exp(-g * z - repulsion * exp(-decay * (z - a)));
        const double gap = z / a - 1;
        const double mu = lubricated
                              // Bevan and Prieve's fit of Brenner's series, to 1 %
                              ? (6 * gap * gap + 2 * gap) / (6 * gap * gap + 9 * gap + 2)
                              : 1 - 9 * u / 8 + pow(u, 3) / 2 - pow(u, 5) / 8;
        for (int k = 0; k < 2; k++) {
            sum[k] += k == 0 ? weight : weight / mu;
            first[k] += z * (k == 0 ? weight : weight / mu);
        }
    }
    const double right = first[0] / sum[0], withoutDrift = first[1] / sum[1];
    EXPECT_GT(right - withoutDrift, 0.15);
    for (const auto& [scheme, law] : cases) {
        const string name = string(traitsOf(scheme).name) + ", noise law " + to_string(law);
        SCOPED_TRACE(name);
        OverdampedScene scene(scheme, T1, 0.05);
        scene.integrator.setNoiseLaw(law);
        for (int i = 0; i < 100; i++)
            scene.addMassless(sphereKind(a), Vec3(0, 0, right + 0.01 * i));
        scene.fluid->setBoundary(MobilityForce::NoSlipWall);
        if (lubricated) scene.fluid->setLubrication(true);
        scene.addWells("z + 10*exp(-3*(z-1))");
        // Relaxation takes about 10 time units, so every replica has about 8 independent heights of
        // standard deviation 1.
        const Estimate found = meanOverReplicas(
            scene, 1, 300, 3000, [](const vector<Vec3>& R, int b) { return R[b][2]; });
        EXPECT_LT(found.error, 0.05);
        expectMean(name + ", height", found,
                   scheme == RigidHI::EulerMaruyama ? withoutDrift : right);
        if (scheme == RigidHI::EulerMaruyama) {
            EXPECT_GT(right - found.mean, 5 * found.error);
        } else {
            EXPECT_GT(found.mean - withoutDrift, 5 * found.error);
        }
    }
}

}  // namespace

/**
 * TestOverdampedSchemes has the exact drift and covariance of a step of every scheme. Here many
 * steps follow each other: without drift, with two kinds of drift, and with numbers of another law.
 */
TEST(OverdampedWall, HeightAboveAWall) {
    checkHeights({{RigidHI::EulerMaruyama, RigidHI::Gaussian},
                  {RigidHI::TrapezoidalSlip, RigidHI::Gaussian},
                  {RigidHI::FixmanMidpoint, RigidHI::TwoPoint}});
}
TEST(OverdampedWall, FullHeightAboveAWallOfOtherSchemes) {
    vector<pair<Scheme, RigidHI::NoiseLaw>> cases;
    for (const Named& s : schemes)
        if (s.scheme != RigidHI::DriftCorrectorFD)  // three times the cost of DriftCorrectorRFD
            cases.push_back({s.scheme, RigidHI::Gaussian});
    cases.push_back({RigidHI::RandomFiniteDifference, RigidHI::TwoPoint});
    checkHeights(cases);
}

/** Lubrication makes the drift near the wall stronger. */
TEST(OverdampedWall, FullHeightAboveAWallWithLubrication) {
    checkHeights({{RigidHI::EulerMaruyama, RigidHI::Gaussian},
                  {RigidHI::TractionEulerMaruyama, RigidHI::Gaussian},
                  {RigidHI::FixmanMidpoint, RigidHI::Gaussian}},
                 true);
}

/**
 * Two spheres with lubrication that a spring holds near contact have the distances of the density
 * r^2 exp(-U/kT); without drift, of this density over the mobility along their line.
 */
TEST(OverdampedWall, FullDistancesOfLubricatedPairs) {
    const string energy = "20*(r-2.3)^2 + 4*exp(-20*(r-2))";
    double sum = 0, first = 0;
    for (double r = 2.0005; r < 4; r += 0.001) {
        const double weight = r * r * exp(-20 * pow(r - 2.3, 2) - 4 * exp(-20 * (r - 2)));
        sum += weight;
        first += r * weight;
    }
    const double right = first / sum;
    for (const Scheme scheme :
         {RigidHI::EulerMaruyama, RigidHI::TractionEulerMaruyama, RigidHI::FixmanMidpoint}) {
        const string name = traitsOf(scheme).name;
        SCOPED_TRACE(name);
        OverdampedScene scene(scheme, T1, 0.002);
        auto* springs = new CustomBondForce(energy);
        for (int i = 0; i < 100; i++) {
            for (int k = 0; k < 2; k++) scene.addMassless(sphereKind(1), Vec3(10 * i, 0, 2.3 * k));
            springs->addBond(2 * i, 2 * i + 1, {});
        }
        scene.system.addForce(springs);
        scene.fluid->setLubrication(true);
        const Estimate found = meanOverReplicas(
            scene, 2, 600, 6000,
            [](const vector<Vec3>& R, int first) { return norm(R[first + 1] - R[first]); });
        EXPECT_LT(found.error, 0.01);
        if (scheme == RigidHI::EulerMaruyama)
            EXPECT_GT(right - found.mean, 5 * found.error);
        else
            expectMean(name + ", distance", found, right);
    }
}

/**
 * Default finite differences must not displace long bodies near the wall through it, at any
 * tolerance.
 */
TEST(OverdampedWall, CoarseTolerancesNearTheWall) {
    for (const Named& s : schemes) {
        OverdampedScene scene(s.scheme, T1, 1e-3);
        scene.fluid->setBoundary(MobilityForce::NoSlipWall);
        scene.fluid->setViscosity(1 / (6 * M_PI));
        scene.fluid->setSolver(MobilityForce::MatrixFree);
        scene.fluid->setSolverTolerance(1e-3);
        BodyKind rod = {"long rod of two rows", 0, Vec3(), {}, vector<double>(12, 0.6)};
        for (int i = 0; i < 12; i++) rod.sites.push_back(Vec3(i / 2, i % 2, 0));
        for (int i = 0; i < 6; i++) scene.addMassless(rod, Vec3(8 * (i % 2), 3 * (i / 2), 1.0));
        scene.start(testPlatform());
        const VectorXd before = scene.state();
        scene.integrator.step(s.scheme == RigidHI::DriftCorrectorFD ? 2 : 10);
        // After 10 steps of 1e-3 the standard deviation of a blob is below sqrt(2 0.01) (1 +
        // turning).
        EXPECT_LT((scene.state() - before).cwiseAbs().maxCoeff(), 6 * sqrt(0.02) * 2) << s.name;
    }
}

/**
 * Two hundred bodies above a wall, spheres and multiblobs, cover a fifth of the area. They move
 * only as far as diffusion allows.
 */
TEST(OverdampedWall, TwoHundredBodiesAboveAWall) {
    const int n = 200;
    const double spacing = 4;  // a square lattice of discs of radius 1: pi/16 of the area
    for (const Named& s : schemes) {
        if (s.scheme == RigidHI::DriftCorrectorFD) continue;  // 1200 square roots a step
        OverdampedScene scene(s.scheme, T1, 0.02);
        scene.fluid->setBoundary(MobilityForce::NoSlipWall);
        scene.fluid->setViscosity(1 / (6 * M_PI));
        scene.fluid->setSolver(MobilityForce::MatrixFree);
        scene.fluid->setSolverTolerance(1e-3);
        BodyKind tetramer = {"tetramer", 0, Vec3(), {}, {0.5, 0.5, 0.5, 0.5}};
        for (const Vec3& v : {Vec3(1, 1, 1), Vec3(1, -1, -1), Vec3(-1, 1, -1), Vec3(-1, -1, 1)})
            tetramer.sites.push_back(v * (0.5 / sqrt(2.0)));
        for (int i = 0; i < n; i++)
            scene.addMassless(i % 4 ? sphereKind(1) : tetramer,
                              Vec3(spacing * (i % 15), spacing * (i / 15), 1.6),
                              OverdampedScene::randomTurn(i));
        scene.addWells("z + 10*exp(-3*(z-0.6))");
        scene.start(testPlatform(), 2);
        const VectorXd before = scene.state();
        scene.integrator.step(2);
        const VectorXd moved = scene.state() - before;
        EXPECT_TRUE(moved.allFinite()) << s.name;
        // The variance of each coordinate is at most 2 kT t/(6 pi eta a) with a >= 0.5, and turning
        // adds as much again.
        EXPECT_LT(moved.cwiseAbs().maxCoeff(), 6 * sqrt(2 * 0.04 * 2 * 2)) << s.name;
        EXPECT_GT(moved.squaredNorm() / moved.size(), 0.01) << s.name;
        EXPECT_GT(scene.integrator.getStepStatistics().at("solverIterations"), 0) << s.name;
    }
}
