// A no-slip wall by the public API: published values, positive definite mobilities near contact,
// rejected steps, refused input, and equilibrium.

#include <openmm/CustomExternalForce.h>
#include <openmm/serialization/XmlSerializer.h>

#include <sstream>

#include "HydrodynamicSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

struct WallScene : FluidScene {
    explicit WallScene(double height = 0, double temperature = 0, double h = 0.01)
        : FluidScene(temperature, h) {
        fluid->setBoundary(MobilityForce::NoSlipWall);
        fluid->setWallHeight(height);
    }
};

/** The smallest eigenvalue in units in which every diagonal entry is 1. */
double smallestEigenvalue(const MatrixXd& M) {
    const VectorXd d = M.diagonal().cwiseSqrt().cwiseInverse();
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(MatrixXd(d.asDiagonal() * M * d.asDiagonal()))
        .eigenvalues()[0];
}

/** The lowest point of the blobs of a kind with its origin at 0. */
double lowestPoint(const BodyKind& kind, const QuaternionArray& q) {
    double lowest = INFINITY;
    for (size_t i = 0; i < kind.sites.size(); i++)
        if (kind.radii[i] > 0) lowest = min(lowest, rotate(q, kind.sites[i])[2] - kind.radii[i]);
    return lowest;
}

}  // namespace

// ---- Mobilities ----

TEST(Wall, ValuesOfOneSphere) {
    // The expected values are those of Swan and Brady 2007. A sphere that is pulled along the wall
    // rolls along it.
    const double a = 0.7, eta = 2.5, height = -1.3;
    for (double u : {1.0, 0.8, 0.3}) {
        WallScene scene(height);
        scene.fluid->setViscosity(eta);
        scene.add(sphereKind(a), Vec3(3, -2, height + a / u));
        scene.start(testPlatform());
        const double t = 1 / (6 * M_PI * eta * a), r = 1 / (8 * M_PI * eta * a * a * a);
        MatrixXd expected = MatrixXd::Zero(6, 6);
        expected.diagonal() << Vector3d::Constant(
            t * (1 - 9 * u / 16 + pow(u, 3) / 8 - pow(u, 5) / 16)),
            Vector3d::Constant(r * (1 - 5 * pow(u, 3) / 16));
        expected(2, 2) = t * (1 - 9 * u / 8 + pow(u, 3) / 2 - pow(u, 5) / 8);
        expected(5, 5) = r * (1 - pow(u, 3) / 8);
        expected(4, 0) = expected(0, 4) = 3 * pow(u, 4) / 32 * t / a;
        expected(3, 1) = expected(1, 3) = -expected(4, 0);
        EXPECT_LT(difference(scene.mobility(), expected), 1e-13) << u;
    }
}

TEST(Wall, ValuesOfTwoSpheres) {
    // The expected values were computed independently, and equal those of the code of Delong et al.
    // 2015, for a = 1, eta = 1/(6 pi).
    WallScene scene;
    scene.fluid->setViscosity(1 / (6 * M_PI));
    scene.add(sphereKind(1), Vec3(0, 0, 1.2));
    scene.add(sphereKind(1), Vec3(2.5, 1, 3));
    scene.start(testPlatform());
    Matrix3d tt, rt, rr;
    tt << 0.1563498397, 0.0399050815, 0.0959610869, 0.0399050815, 0.0725491686, 0.0383844348,
        0.0104756178, 0.0041902471, 0.0076203779;
    rt << -0.0098960427, -0.0348598456, -0.0010756279, 0.0556415353, 0.0098960427, 0.0026890697,
        -0.0160350448, 0.0400876120, 0;
    rr << -0.0026775858, 0.0051614653, 0.0180264142, 0.0051614653, -0.0135166629, 0.0072105657,
        0.0103826096, 0.0041530439, -0.0042110697;
    const MatrixXd N = scene.mobility();
    EXPECT_LT((N.block(0, 6, 3, 3) - tt).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((N.block(3, 6, 3, 3) - rt).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((N.block(3, 9, 3, 3) - rr).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((N - N.transpose()).cwiseAbs().maxCoeff(), 1e-15);
}

TEST(Wall, MixturesOfBodiesAndFreeParticles) {
    for (int seed = 0; seed < 6; seed++) {
        WallScene scene(0.4);
        for (const BodyKind& kind :
             {sphereKind(0.5), boomerangKind(), rodKind(),
              BodyKind{
                  "sphere off the origin", 1, Vec3(0.3, 0.5, 0.6), {Vec3(0.2, 0.1, -0.4)}, {0.7}}})
            scene.add(kind);
        if (seed % 2)
            for (double radius : {0.3, 0.0, 0.6})
                scene.addFree(1, radius, Vec3(2 * radius, 0.3, 0.4 + radius + readTolerance(0, 1)));
        scene.start(testPlatform());
        mt19937 random(seed);
        uniform_real_distribution<double> u(0, 1);
        vector<QuaternionArray> q = randomTurns(4, random);
        vector<Vec3> R = randomPlaces(4, seed < 3 ? 4 : 1.5, 0, random);
        for (int b = 0; b < 4; b++)  // touching, near, anywhere
            R[b][2] = 0.4 - lowestPoint(scene.bodies[b], q[b]) + (b == seed % 4 ? 0 : u(random));
        scene.pose(R, q);
        const MatrixXd expected = scene.expected().mobility.topLeftCorner(24, 24);
        EXPECT_LT(difference(scene.mobility(), expected), 1e-10) << "scene " << seed;
        EXPECT_LT(difference(expected * scene.friction() * expected, expected), 1e-9)
            << "scene " << seed;
    }
}

TEST(Wall, PositiveDefiniteAtTheWall) {
    // The bodies overlap, and some touch the wall or reach through it as far as Crossing allows.
    for (auto rejection : {CustomRigidHIIntegrator::Overlap, CustomRigidHIIntegrator::Crossing}) {
        const bool crossing = rejection == CustomRigidHIIntegrator::Crossing;
        WallScene scene(-0.7);
        scene.integrator.setWallRejection(rejection);
        for (const BodyKind& kind :
             {sphereKind(0.5), sphereKind(0.9), boomerangKind(), sphereKind(0.2)})
            scene.add(kind);
        mt19937 random(3);
        uniform_real_distribution<double> u(0, 1);
        double smallest = INFINITY;
        for (int trial = 0; trial < 400; trial++) {
            vector<QuaternionArray> q = randomTurns(4, random);
            vector<Vec3> R = randomPlaces(4, trial % 2 ? 1 : 4, 0, random);
            for (int b = 0; b < 4; b++) {
                // With Crossing no centre may be behind the wall. So the smallest blob of each kind
                // determines how far the body may sink.
                const double depth = crossing ? 0.9 * *min_element(scene.bodies[b].radii.begin(),
                                                                   scene.bodies[b].radii.end())
                                              : 0;
                R[b][2] = -0.7 - lowestPoint(scene.bodies[b], q[b]) - depth +
                          (u(random) < 0.4 ? 0 : 2 * u(random));
            }
            if (trial == 0) scene.start(testPlatform());
            scene.pose(R, q);
            const MatrixXd N = scene.mobility();
            ASSERT_LT((N - N.transpose()).cwiseAbs().maxCoeff(), 1e-15 * N.cwiseAbs().maxCoeff());
            smallest = min(smallest, smallestEigenvalue(N));
            ASSERT_GT(smallest, 0) << trial;
        }
        cout << "smallest eigenvalue " << smallest << endl;
    }
}

// ---- Particles at the wall's limit ----

TEST(Wall, AStartAtContactIsNoOverlap) {
    // The lowest blob of a turned body touches the wall. Rounding puts this blob to either side of
    // contact.
    mt19937 random(8);
    for (double height : {0.0, 0.1, -37.3, 1e4}) {
        WallScene scene(height);
        scene.add(boomerangKind());
        scene.add(sphereKind(0.3), Vec3(5, 0, 0));
        int below = 0;
        for (int trial = 0; trial < 30; trial++) {
            const vector<QuaternionArray> q = randomTurns(2, random);
            const vector<Vec3> R = {Vec3(0, 0, height - lowestPoint(scene.bodies[0], q[0])),
                                    Vec3(5, 0, height + 0.3)};
            if (trial == 0) scene.start(testPlatform());
            scene.pose(R, q);
            for (const LabBody& body : scene.labBodies())
                for (size_t i = 0; i < body.radii.size(); i++)
                    below += body.R[2] + body.offsets[i][2] - height < body.radii[i];
            EXPECT_GT(smallestEigenvalue(scene.mobility()), 0);
        }
        EXPECT_GT(below, 0) << height;
        // A position below contact by more than rounding is an overlap.
        scene.pose(
            {Vec3(0, 0, height + 9), Vec3(5, 0, height + 0.3 * (1 - 1e-9) - 1e-11 * abs(height))},
            {{{1, 0, 0, 0}}, {{1, 0, 0, 0}}});
        expectError([&] { scene.mobility(); },
                    {"particle 5 (body 1)", "less than its radius, 0.3 nm"});
    }
}

TEST(Wall, AStartBelowTheLimitNamesParticleAndBody) {
    for (auto rejection : {CustomRigidHIIntegrator::Overlap, CustomRigidHIIntegrator::Crossing}) {
        WallScene scene(2);
        scene.integrator.setWallRejection(rejection);
        scene.add(sphereKind(0.5), Vec3(0, 0, 3));
        scene.add(boomerangKind(), Vec3(4, 0, 5));
        scene.addFree(1, 0.25, Vec3(0, 4, 3));
        scene.start(testPlatform());
        scene.mobility();
        const bool crossing = rejection == CustomRigidHIIntegrator::Crossing;
        const string sign = crossing ? "-" : "";
        const double z = crossing ? 1.875 : 2.125;
        const vector<string> remedy =
            crossing
                ? vector<string>{"no mobility; move it above the wall, or use smaller time steps"}
                : vector<string>{"less than its radius", "setWallRejection(Crossing)"};
        const auto expectNamed = [&](const string& particle) {
            vector<string> fragments = {particle + " has its centre " + sign +
                                        "0.125 nm above the wall at z = 2 nm"};
            fragments.insert(fragments.end(), remedy.begin(), remedy.end());
            expectError([&] { scene.mobility(); }, fragments);
            expectError([&] { scene.friction(); }, fragments);
            expectError(
                [&] { scene.fluid->applyMobilityInContext(*scene.context, vector<double>(12)); },
                fragments);
            expectError([&] { scene.integrator.step(1); }, fragments);
        };
        const vector<QuaternionArray> q(2, {{1, 0, 0, 0}});
        scene.pose({Vec3(0, 0, z), Vec3(4, 0, 5)}, q);
        expectNamed("particle 0 (body 0)");
        scene.pose({Vec3(0, 0, 3), Vec3(4, 0, z)}, q);
        expectNamed("particle 1 (body 1)");
        scene.pose({Vec3(0, 0, 3), Vec3(4, 0, 5)}, q);
        auto x = positionsOf(*scene.context);
        x[6][2] = z;
        scene.context->setPositions(x);
        expectNamed("particle 6 (in no body)");
        x[6][2] = 3;
        scene.context->setPositions(x);
        scene.integrator.step(1);
    }
}

TEST(Wall, RejectionActsAtOnceAndIsTheIntegrators) {
    WallScene scene;
    scene.add(sphereKind(0.5), Vec3(0, 0, 0.6));
    scene.add(sphereKind(0.4), Vec3(2, 0, 1));
    scene.start(testPlatform());
    scene.integrator.step(1);
    scene.pose({Vec3(0, 0, 0.25), Vec3(2, 0, 1)}, vector<QuaternionArray>(2, {{1, 0, 0, 0}}));
    expectError([&] { scene.mobility(); }, {"setWallRejection(Crossing)"});
    const double products = scene.integrator.getStepStatistics().at("mobilityProducts");
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Crossing);
    // The mobility is that at contact, halved twice.
    const MatrixXd crossing = scene.mobility();
    EXPECT_LT(difference(crossing, scene.expected().mobility), 1e-13);
    EXPECT_NEAR(crossing(2, 2) * 6 * M_PI * 0.6 * 0.5, 0.25 * (1 - 9.0 / 8 + 0.5 - 1.0 / 8), 1e-15);
    scene.integrator.step(1);
    EXPECT_GT(scene.integrator.getStepStatistics().at("mobilityProducts"),
              products);  // the counters go on
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Overlap);
    expectError([&] { scene.integrator.step(1); }, {"particle 0 (body 0)"});
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Crossing);
    scene.integrator.step(1);
}

TEST(Wall, StepsThroughTheWallAreRedone) {
    // Bodies are pressed to the wall so hard that many steps would end in it. No particle is ever
    // found beyond the limit.
    for (auto rejection : {CustomRigidHIIntegrator::Overlap, CustomRigidHIIntegrator::Crossing})
        for (bool multiblob : {false, true}) {
            const double height = 1.5,
                         limit = rejection == CustomRigidHIIntegrator::Overlap ? 1 : 0;
            WallScene scene(height, T1, 0.1);
            scene.integrator.setWallRejection(rejection);
            scene.add(multiblob ? boomerangKind() : sphereKind(0.5),
                      Vec3(0, 0, height + (multiblob ? 2.2 : 0.6)));
            auto* weight = new CustomExternalForce("4*z");
            weight->addParticle(0, vector<double>());
            scene.system.addForce(weight);
            scene.start(testPlatform());
            for (int i = 0; i < 1500; i++) {
                scene.integrator.step(1);
                const auto x = positionsOf(*scene.context);
                for (size_t p = 0; p < x.size(); p++)
                    ASSERT_GE(x[p][2] - height, limit * scene.fluid->getParticleRadius(p) - 1e-11);
            }
            cout << scene.integrator.getNumRejectedSteps() << " of 1500 steps were redone" << endl;
            EXPECT_GT(scene.integrator.getNumRejectedSteps(), 10);
        }
}

TEST(Wall, RejectionsThatDoNotHelp) {
    // The body is pushed so hard that no noise helps, or there is no noise, or the body reaches the
    // wall before any noise acts.
    for (double force : {30.0, 1000.0})
        for (double temperature : {0.0, 1e-6}) {
            WallScene scene(0, temperature, 0.1);
            scene.fluid->setViscosity(1e-4);
            scene.add(sphereKind(0.5), Vec3(0, 0, 0.6));
            auto* push = new CustomExternalForce(to_string(force) + "*z");
            push->addParticle(0, vector<double>());
            scene.system.addForce(push);
            scene.integrator.setMaximumRejections(5);
            scene.start(testPlatform());
            const auto before = positionsOf(*scene.context);
            expectError(
                [&] { scene.integrator.step(1); },
                {force > 100        ? "half a step ahead, where the friction is computed: "
                 : temperature == 0 ? "at temperature 0 there is no noise, so that redoing the "
                                      "step cannot help: take a smaller step, or add a repulsion"
                                    : "5 times in a row",
                 "step 1: ", "particle 0 (body 0)", "above the wall at z = 0 nm"});
            EXPECT_TRUE(sameBits(positionsOf(*scene.context), before));
        }
}

// ---- What is refused ----

TEST(Wall, ModelsWithoutAWall) {
    for (auto model : {MobilityForce::FreeDraining, MobilityForce::StokesianDynamics}) {
        WallScene scene;
        scene.fluid->setModel(model);
        scene.add(sphereKind(0.5), Vec3(0, 0, 3));
        expectError(
            [&] { scene.start(testPlatform()); },
            {"boundary NoSlipWall can be used with the model RotnePragerYamakawa, not with ",
             model == MobilityForce::FreeDraining ? "FreeDraining; use" : "StokesianDynamics; use",
             "setModel(RotnePragerYamakawa) or setBoundary(Unbounded or Periodic)"});
    }
}

TEST(Wall, SettingsOutOfBounds) {
    MobilityForce fluid;
    for (double bad : {double(NAN), double(INFINITY), -double(INFINITY)})
        expectError([&] { fluid.setWallHeight(bad); },
                    {"setWallHeight(): height is ", "give the z coordinate of the wall"});
    CustomRigidHIIntegrator integrator(300, 0.001);
    for (int bad : {-1, 2}) {
        expectError(
            [&] {
                fluid.setSphereWallMobility(static_cast<MobilityForce::SphereWallMobility>(bad));
            },
            {"sphere-wall mobility " + to_string(bad) + " is unknown", "FromModel, BestKnown"});
        expectError(
            [&] {
                integrator.setWallRejection(
                    static_cast<CustomRigidHIIntegrator::WallRejection>(bad));
            },
            {"wall rejection " + to_string(bad) + " is unknown", "Overlap, Crossing"});
    }
    EXPECT_EQ(fluid.getWallHeight(), 0);
    EXPECT_EQ(integrator.getWallRejection(), CustomRigidHIIntegrator::Overlap);
}

TEST(Wall, BestKnownDoesNotGoWithCrossing) {
    const vector<string> fragments = {
        "sphere-wall mobility BestKnown", "it cannot be used with the wall rejection Crossing",
        "setWallRejection(Overlap) or setSphereWallMobility(FromModel)"};
    WallScene scene;
    scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Crossing);
    scene.add(sphereKind(0.5), Vec3(0, 0, 3));
    expectError([&] { scene.start(testPlatform()); }, fragments);
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Overlap);
    scene.start(testPlatform());
    const MatrixXd before = scene.mobility();
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Crossing);
    expectError([&] { scene.mobility(); }, fragments);
    expectError([&] { scene.integrator.step(1); }, fragments);
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Overlap);
    EXPECT_EQ(scene.mobility(), before);
    scene.integrator.step(1);
}

TEST(Wall, BestKnownAndCrossingAreRefusedWhereverTheyMeet) {
    // The first positions define the shape, so the fluid is made when these are set.
    const vector<string> fragments = {"BestKnown",
                                      "it cannot be used with the wall rejection Crossing"};
    WallScene scene;
    scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
    for (int p = 0; p < 3; p++) {
        scene.system.addParticle(1.0);
        scene.fluid->addParticle(0.3);
    }
    scene.integrator.addRigidBody({0, 1, 2});
    scene.context = make_unique<Context>(scene.system, scene.integrator, testPlatform());
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Crossing);
    scene.context->setPositions({Vec3(0, 0, 2), Vec3(0.5, 0, 2), Vec3(0, 0.6, 2)});
    expectError([&] { scene.integrator.step(1); }, fragments);
    expectError([&] { scene.integrator.getBodyPositions(); }, fragments);
    expectError([&] { scene.mobility(); }, fragments);
    expectError([&] { scene.fluid->updateParametersInContext(*scene.context); }, fragments);
    scene.integrator.setWallRejection(CustomRigidHIIntegrator::Overlap);
    scene.integrator.step(1);
}

TEST(Wall, BestKnownWithoutAWallIsRefused) {
    const vector<string> fragments = {"sphere-wall mobility BestKnown", "boundary Unbounded",
                                      "setBoundary(NoSlipWall)",
                                      "setSphereWallMobility(FromModel)"};
    for (auto model : {MobilityForce::RotnePragerYamakawa, MobilityForce::FreeDraining,
                       MobilityForce::StokesianDynamics}) {
        FluidScene scene;
        scene.fluid->setModel(model);
        scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
        scene.add(sphereKind(0.5), Vec3(0, 0, 3));
        expectError([&] { Context context(scene.system, scene.integrator, testPlatform()); },
                    fragments);
        scene.fluid->setSphereWallMobility(MobilityForce::FromModel);
        scene.start(testPlatform());
        scene.integrator.step(1);
    }
}

TEST(Wall, BlobsAboveEachOtherThatAreBothLiftedToContact) {
    // With Crossing, blobs below contact count as blobs at contact. Two blobs above each other are
    // then at one place.
    for (double x : {0.0, 0.1}) {
        WallScene scene;
        scene.integrator.setWallRejection(CustomRigidHIIntegrator::Crossing);
        scene.add({"blobs",
                   1,
                   Vec3(1, 1, 1),
                   {Vec3(0, 0, 0.2), Vec3(x, 0, 0.5), Vec3(1, 0, 1)},
                   {0.6, 0.6, 0.6}});
        scene.start(testPlatform());
        if (x > 0) {
            scene.integrator.step(1);
            continue;
        }
        expectError([&] { scene.integrator.step(1); },
                    {"particle 0 (body 0) and particle 1 (body 0)", "same place"});
        expectError([&] { scene.mobility(); }, {"particle 0 (body 0) and particle 1 (body 0)"});
    }
}

TEST(Wall, WhatNeedsReinitialize) {
    WallScene scene;
    scene.add(sphereKind(0.5), Vec3(0, 0, 1));
    scene.start(testPlatform());
    const MatrixXd before = scene.mobility();
    const auto update = [&] { scene.fluid->updateParametersInContext(*scene.context); };
    scene.fluid->setBoundary(MobilityForce::Unbounded);
    expectError(update, {"cannot change the model or boundary of a MobilityForce", "reinitialize"});
    scene.fluid->setBoundary(MobilityForce::NoSlipWall);
    scene.fluid->setWallHeight(-1);
    expectError(update, {"cannot change the wall height or sphere-wall mobility of a MobilityForce",
                         "reinitialize"});
    EXPECT_EQ(scene.mobility(), before);
    scene.context->reinitialize(true);
    EXPECT_GT(scene.mobility()(2, 2), 1.2 * before(2, 2));
}

// ---- Best known ----

TEST(Wall, BestKnownMobilityOfOneSphere) {
    // The exact values are those of tools/sphere_wall_mobility.py.
    const struct {
        double gap, along, across, turnAlong, turnNormal, rolling;
    } rows[] = {{0.01, 0.29611765, 0.00981391, 0.45228199, 0.84513430, 0.03654131},
                {0.1, 0.44304988, 0.08726645, 0.68955449, 0.89520325, 0.02703135},
                {1, 0.72321218, 0.47046966, 0.95991472, 0.98432259, 0.00348818}};
    const double a = 0.6, eta = 1.7, height = 2.5;
    for (const auto& row : rows)
        for (bool free : {false, true}) {
            WallScene scene(height);
            scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
            scene.fluid->setViscosity(eta);
            scene.add(sphereKind(a), Vec3(1, 1, height + a * (1 + row.gap)));
            if (free)
                scene.addFree(1, 1e-9, Vec3(0, 0, height + 1e5));  // too small and far to matter
            scene.start(testPlatform());
            const MatrixXd N = scene.mobility() * 6 * M_PI * eta * a;
            EXPECT_NEAR(N(0, 0), row.along, 1e-6);
            EXPECT_NEAR(N(2, 2), row.across, 1e-6);
            EXPECT_NEAR(N(3, 3) * a * a * 4 / 3, row.turnAlong, 1e-6);
            EXPECT_NEAR(N(5, 5) * a * a * 4 / 3, row.turnNormal, 1e-6);
            EXPECT_NEAR(N(4, 0) * a, row.rolling, 1e-6);
            EXPECT_NEAR(N(3, 1) * a, -row.rolling, 1e-6);
        }
}

TEST(Wall, BestKnownIsACongruenceOfTheModel) {
    // The mobility between spheres is that of the model, scaled by the factors of each sphere
    // alone.
    WallScene model, best;
    best.fluid->setSphereWallMobility(MobilityForce::BestKnown);
    MatrixXd N[2];
    for (WallScene* scene : {&model, &best}) {
        scene->add(sphereKind(0.5), Vec3(0, 0, 0.55));
        scene->add(sphereKind(0.8), Vec3(3, 1, 2));
        scene->add(boomerangKind(), Vec3(-3, 0, 1));
        scene->start(testPlatform());
        N[scene == &best] = scene->mobility();
    }
    // Components across the wall do not mix with others, so that factors are ratios of diagonal
    // entries.
    const auto factor = [&](int row) { return sqrt(N[1](row, row) / N[0](row, row)); };
    EXPECT_LT(factor(2), 0.8);
    EXPECT_NEAR(N[1](2, 8), factor(2) * factor(8) * N[0](2, 8), 1e-15);
    EXPECT_NEAR(N[1](5, 11), factor(5) * factor(11) * N[0](5, 11), 1e-15);
    EXPECT_NEAR(factor(14), 1, 1e-3);  // a multiblob is affected only by the others moving less
    EXPECT_GT(smallestEigenvalue(N[1]), 0.1);
}

TEST(Wall, BestKnownRefusesContact) {
    WallScene scene;
    scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
    scene.add(sphereKind(0.5), Vec3(0, 0, 0.5));
    scene.add(boomerangKind(), Vec3(5, 0, 0.5));  // the lowest blobs touch, which the model takes
    scene.start(testPlatform());
    const vector<string> fragments = {"particle 0 (body 0) touches the wall", "BestKnown",
                                      "move it up"};
    expectError([&] { scene.mobility(); }, fragments);
    expectError([&] { scene.integrator.step(1); }, fragments);
    scene.pose({Vec3(0, 0, 0.5 + 1e-9), Vec3(5, 0, 0.5)},
               vector<QuaternionArray>(2, {{1, 0, 0, 0}}));
    const MatrixXd N = scene.mobility();
    EXPECT_NEAR(N(2, 2) * 6 * M_PI * 0.6 * 0.5 / 2e-9, 1, 1e-5);  // apart from the neighbour's
                                                                  // effect
    EXPECT_GT(smallestEigenvalue(N), 0);
}

// ---- Beside other features ----

TEST(Wall, OwnTensorsAreThoseOfUnboundedFluid) {
    SKIP_ON_SINGLE_PRECISION_DEVICES(
        "members 1e9 nm above the wall have no distance from each other there");
    const MatrixXd own = tensorWithoutSymmetry(5);
    for (double gap : {1e9, 0.3}) {
        WallScene scene, plain, bulk;
        bulk.fluid->setBoundary(MobilityForce::Unbounded);
        for (WallScene* s : {&scene, &plain, &bulk}) s->add(boomerangKind(), Vec3(0, 0, 0.5 + gap));
        scene.fluid->setBodyMobility(0, rowsOf(own));
        for (WallScene* s : {&scene, &plain, &bulk}) s->start(testPlatform());
        const auto power = [](const MatrixXd& m, double p) {
            const Eigen::SelfAdjointEigenSolver<MatrixXd> e(m);
            return MatrixXd(e.eigenvectors() *
                            e.eigenvalues().array().pow(p).matrix().asDiagonal() *
                            e.eigenvectors().transpose());
        };
        // Square roots do not depend on the inner order of the axes, nor on the frame.
        const MatrixXd B = power(own, 0.5) * power(bulk.mobility(), -0.5);
        EXPECT_LT(difference(scene.mobility(), B * plain.mobility() * B.transpose()), 1e-10) << gap;
        if (gap > 1) {
            EXPECT_LT(difference(scene.mobility(), own), 1e-8);
        }
    }
}

TEST(Wall, OneBodyIsNotConstantInItsFrame) {
    // The quantities that are computed once in unbounded fluid are computed in every step here,
    // also for a sphere and for a free particle.
    for (int kind = 0; kind < 3; kind++) {
        WallScene scene(0, T1, 0.001);
        if (kind == 2)
            scene.addFree(1, 0.5, Vec3(0, 0, 0.6));
        else
            scene.add(kind == 0 ? sphereKind(0.5) : boomerangKind(), Vec3(0, 0, 0.6));
        scene.start(testPlatform());
        scene.integrator.step(10);
        const auto before = scene.integrator.getStepStatistics();
        EXPECT_GE(before.at("mobilityProducts"), 10) << kind;
        EXPECT_EQ(before.at("squareRoots"), 10) << kind;
        EXPECT_NE(scene.integrator.describeEffects().find("above a no-slip wall at z = 0 nm"),
                  string::npos);
        if (kind == 2) continue;
        const MatrixXd low = scene.mobility();
        scene.pose({Vec3(0, 0, 5)}, {{{1, 0, 0, 0}}});
        EXPECT_GT(scene.mobility()(2, 2), 1.5 * low(2, 2)) << kind;
    }
}

TEST(Wall, TwoContextsAtDifferentWalls) {
    WallScene low(-1), high(0.5);
    for (WallScene* scene : {&low, &high}) {
        scene->add(sphereKind(0.4), Vec3(0, 0, 1));
        scene->start(testPlatform());
    }
    const MatrixXd a = low.mobility(), b = high.mobility();
    EXPECT_GT(difference(a, b), 0.1);
    high.integrator.setWallRejection(CustomRigidHIIntegrator::Crossing);
    high.pose({Vec3(0, 0, 0.6)}, {{{1, 0, 0, 0}}});
    high.mobility();
    EXPECT_EQ(low.mobility(), a);
}

TEST(Wall, MatrixFreeIsDense) {
    // One step from the same state is compared, in the norm of momenta over roots of masses, with
    // blobs at the wall.
    const double tolerance = 1e-6;
    for (bool bestKnown : {false, true})
        for (double h : {1e-3, 0.3}) {
            VectorXd Z[2];
            for (bool matrixFree : {false, true}) {
                WallScene scene(0, 1e-8 * T1, h);
                scene.fluid->setSphereWallMobility(bestKnown ? MobilityForce::BestKnown
                                                             : MobilityForce::FromModel);
                scene.fluid->setSolver(matrixFree ? MobilityForce::MatrixFree
                                                  : MobilityForce::Dense);
                scene.fluid->setSolverTolerance(tolerance);
                mt19937 random(5);
                for (int b = 0; b < 8; b++) {
                    const BodyKind kind = b % 3 == 0   ? boomerangKind()
                                          : b % 3 == 1 ? rodKind()
                                                       : sphereKind(0.4);
                    const QuaternionArray q = randomQuaternion(random);
                    scene.add(kind, Vec3(2.5 * (b % 3), 2.5 * (b / 3), 1e-3 - lowestPoint(kind, q)),
                              q);
                }
                scene.addFree(1.5, 0.4, Vec3(-1, -1, 0.45));
                scene.start(testPlatform());
                scene.integrator.step(1);
                EXPECT_EQ(scene.integrator.getStepStatistics().at("solverIterations") > 0,
                          matrixFree);
                Z[matrixFree].resize(6 * 8 + 3);
                const auto V = scene.integrator.getBodyVelocities(),
                           W = scene.integrator.getBodyAngularVelocities();
                const auto q = scene.integrator.getBodyOrientations();
                for (int b = 0; b < 8; b++) {
                    const BodyKind& kind = scene.bodies[b];
                    Z[matrixFree].segment<3>(6 * b) = sqrt(kind.mass) * toEigen(V[b]);
                    const Vector3d omega = rotationOf(q[b]).transpose() * toEigen(W[b]);
                    for (int k = 0; k < 3; k++)
                        Z[matrixFree][6 * b + 3 + k] = sqrt(kind.moments[k]) * omega[k];
                }
                Z[matrixFree].tail<3>() = sqrt(1.5) * toEigen(velocitiesOf(*scene.context).back());
            }
            EXPECT_LT((Z[1] - Z[0]).norm(), 5 * tolerance * Z[0].norm()) << "h = " << h;
            EXPECT_GT((Z[1] - Z[0]).norm(), 0);
        }
}

// ---- Equilibrium ----

namespace {

/** Every body has an energy of 3 kT for each nm of height of its blobs' centre, and every blob one
 * of 10 kT exp(-gap/0.4 nm). */
const double weight = 3, repulsion = 10, range = 0.4;
double blobEnergy(double z, double radius, int blobs) {
    return weight / blobs * z + repulsion * exp(-(z - radius) / range);
}

/** Averages by quadrature over the height and over the direction of the vertical in the body frame,
 * with all blobs above the wall at 0. */
map<string, double> gibbs(const BodyKind& kind) {
    const int heights = 200, rings = 24;
    const double highest = 6;  // in units of 0.03, so that cells end where "near" does
    double norm_ = 0;
    map<string, double> mean;
    for (int i = 0; i < rings; i++)
        for (int k = 0; k < 2 * rings; k++) {
            // Mid-points are uniform in n_z, and evenly spaced around the axis.
            const double nz = (2 * i + 1.0) / rings - 1, s = sqrt(1 - nz * nz),
                         angle = (k + 0.5) * M_PI / rings;
            const Vec3 n(s * cos(angle), s * sin(angle), nz);
            double lowest = INFINITY;
            for (size_t b = 0; b < kind.sites.size(); b++)
                if (kind.radii[b] > 0) lowest = min(lowest, kind.sites[b].dot(n) - kind.radii[b]);
            for (int j = 0; j < heights; j++) {
                const double above = (j + 0.5) * highest / heights, z = above - lowest;
                double U = 0;
                for (size_t b = 0; b < kind.sites.size(); b++)
                    if (kind.radii[b] > 0)
                        U += blobEnergy(z + kind.sites[b].dot(n), kind.radii[b], kind.sites.size());
                const double p = exp(-U);
                norm_ += p;
                mean["height"] += p * z;
                mean["height^2"] += p * z * z;
                mean["near"] += p * (above < 0.6);
                for (int c = 0; c < 3; c++) mean["n_" + to_string(c) + "^2"] += p * n[c] * n[c];
                mean["n_0"] += p * n[0];
            }
        }
    for (auto& entry : mean) entry.second /= norm_;
    return mean;
}

}  // namespace

TEST(Wall, HeightsFollowGibbsAndVelocitiesMaxwell) {
    // LangevinHI needs no drift term, however the friction depends on height and orientation. Each
    // replica is a group. If friction and noise were taken at different places, P would have a
    // factor like the inverse mobility. It would lower the sphere's mean height by 4 %: five
    // standard errors.
    const double h = 0.05;
    for (bool multiblob : {false, true})
        for (bool bestKnown : {false, true}) {
            if (multiblob && bestKnown) continue;
            WallScene scene(0, T1, h);
            if (bestKnown) scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
            const BodyKind kind = multiblob ? boomerangKind() : sphereKind(0.5, 1, 0.3);
            auto* field = new CustomExternalForce("w*z+A*exp(-(z-a)/b)");
            field->addGlobalParameter("w", weight / kind.sites.size());
            field->addGlobalParameter("A", repulsion);
            field->addGlobalParameter("b", range);
            field->addPerParticleParameter("a");
            const int copies = multiblob ? 100 : 200;
            mt19937 random(4);
            vector<int> groups;
            for (int c = 0; c < copies; c++) {
                const QuaternionArray q = randomQuaternion(random);
                scene.add(kind, Vec3(0, 0, 0.7 - lowestPoint(kind, q)), q);
                for (size_t i = 0; i < kind.radii.size(); i++)
                    field->addParticle(scene.particles.back()[i], {kind.radii[i]});
                groups.push_back(c);
            }
            scene.system.addForce(field);
            scene.fluid->setGroups(groups);
            scene.start(testPlatform(), 2);
            scene.context->setVelocitiesToTemperature(T1, 5);
            scene.integrator.step(100);
            map<string, vector<double>> sums;
            const int samples = 60;
            for (int s = 0; s < samples; s++) {
                scene.integrator.step(10);
                const auto R = scene.integrator.getBodyPositions(),
                           V = scene.integrator.getBodyVelocities(),
                           W = scene.integrator.getBodyAngularVelocities();
                const auto q = scene.integrator.getBodyOrientations();
                for (int c = 0; c < copies; c++) {
                    const auto add = [&](const string& what, double value) {
                        vector<double>& of = sums[what];
                        of.resize(copies);
                        of[c] += value / samples;
                    };
                    add("height", R[c][2]);
                    add("height^2", R[c][2] * R[c][2]);
                    add("near", R[c][2] + lowestPoint(kind, q[c]) < 0.6);
                    const Matrix3d A = rotationOf(q[c]);
                    const Vector3d omega = A.transpose() * toEigen(W[c]);
                    for (int k = 0; k < 3; k++) {
                        if (multiblob) add("n_" + to_string(k) + "^2", A(2, k) * A(2, k));
                        add("m v^2 of " + to_string(k), kind.mass * V[c][k] * V[c][k]);
                        add("I omega^2 of " + to_string(k), kind.moments[k] * omega[k] * omega[k]);
                    }
                    if (multiblob) add("n_0", A(2, 0));
                }
            }
            const map<string, double> expected = gibbs(kind);
            cout << (multiblob ? "boomerang, " : "sphere, ")
                 << scene.integrator.getNumRejectedSteps() << " rejections\n";
            EXPECT_LT(scene.integrator.getNumRejectedSteps(), 30);
            for (const auto& sum : sums)
                expectMean(sum.first, estimate(sum.second),
                           expected.count(sum.first) ? expected.at(sum.first) : 1);
        }
}
