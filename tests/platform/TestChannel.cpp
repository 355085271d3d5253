// A fluid between slip walls in a Context, with dense matrices and on a grid: redone steps, changes
// of the box, exact resume, and bad input.

#include <openmm/CustomExternalForce.h>
#include <openmm/MonteCarloBarostat.h>

#include <chrono>

#include "HydrodynamicSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;

/** A cubic box of 9 nm, and a channel between y = 1 and y = 6.5 nm. */
struct ChannelScene : FluidScene {
    explicit ChannelScene(double temperature = 0, RigidHI::Scheme scheme = RigidHI::TrapezoidalSlip,
                          MobilityForce::Solver solver = MobilityForce::Dense, double h = 0.002)
        : FluidScene(temperature, h) {
        fluid->setBoundary(MobilityForce::SlipChannel);
        fluid->setModel(MobilityForce::ForceCoupling);
        fluid->setChannelWalls(1, 6.5);
        fluid->setSolver(solver);
        fluid->setSolverTolerance(1e-2);
        integrator.setScheme(scheme);
        side = 9;
    }
    /** A sphere, a multiblob and a free particle, pulled. */
    void addBodies() {
        add(sphereKind(0.8), Vec3(0, 2.2, 8.2));
        add(boomerangKind(), Vec3(-1, 3.5, 2.4));
        addFree(2, 0.5, Vec3(3, 5.2, 4));
        auto* pull = new CustomExternalForce("0.7*x-0.4*y+0.2*z*z");
        for (int i = 0; i < system.getNumParticles(); i++) pull->addParticle(i, vector<double>());
        system.addForce(pull);
    }
};

}  // namespace

TEST(Channel, GridsAreTheLatticeSumToTheTolerance) {
    ChannelScene exact;
    exact.addBodies();
    exact.start(testPlatform());
    const MatrixXd N = exact.mobility();
    const VectorXd root = N.diagonal().cwiseSqrt().cwiseInverse();
    for (double tolerance : {1e-2, 1e-4}) {
        ChannelScene scene(0, RigidHI::TrapezoidalSlip, MobilityForce::MatrixFree);
        scene.fluid->setSolverTolerance(tolerance);
        scene.addBodies();
        scene.start(testPlatform());
        const MatrixXd error = root.asDiagonal() * (scene.mobility() - N) * root.asDiagonal();
        EXPECT_LE(
            Eigen::SelfAdjointEigenSolver<MatrixXd>(error).eigenvalues().cwiseAbs().maxCoeff(),
            tolerance);
    }
}

TEST(Channel, ResumesBitForBit) {
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
        for (auto scheme :
             {RigidHI::LangevinHI, RigidHI::DriftCorrectorFD, RigidHI::TrapezoidalSlip}) {
            const auto start = [&](int threads) {
                auto scene = make_unique<ChannelScene>(T1, scheme, solver);
                scene->addBodies();
                scene->start(testPlatform(), threads);
                return scene;
            };
            const auto toAnotherBox = [](ChannelScene& scene) {
                scene.integrator.step(1);
                scene.context->setPeriodicBoxVectors(Vec3(8, 0, 0), Vec3(0, 9, 0), Vec3(0, 0, 10));
                scene.integrator.step(1);
            };
            expectToResumeBitForBit<ChannelScene>(start, toAnotherBox, 2);
        }
}

TEST(Channel, StepsBeyondEitherWallAreRedone) {
    // A sphere is pushed to a wall. With Overlap its surface stays inside, with Crossing its
    // centre. Near a wall the sphere moves little, so it crosses only in long steps.
    for (bool crossing : {false, true})
        for (double y : {2.0, 5.5}) {
            ChannelScene scene(T1, RigidHI::EulerMaruyama, MobilityForce::Dense,
                               crossing ? 5 : 0.2);
            scene.integrator.setWallRejection(crossing ? RigidHI::Crossing : RigidHI::Overlap);
            scene.add(sphereKind(1), Vec3(4, y, 4));
            auto* push = new CustomExternalForce(y < 4 ? "3*y" : "-3*y");
            push->addParticle(0, vector<double>());
            scene.system.addForce(push);
            scene.start(testPlatform());
            double nearest = 1e9;
            for (int i = 0; i < 300; i++) {
                scene.integrator.step(1);
                const double at = scene.integrator.getBodyPositions()[0][1];
                nearest = min({nearest, at - 1, 6.5 - at});
            }
            EXPECT_GT(scene.integrator.getNumRejectedSteps(), 0);
            EXPECT_GE(nearest, crossing ? 0 : 1 - 1e-12);
            EXPECT_LT(nearest, crossing ? 1 : 1.3);
        }
}

TEST(Channel, StartsBeyondAWallAreRefused) {
    for (double y : {1.5, 6.2}) {
        ChannelScene scene(T1);
        scene.add(sphereKind(0.8), Vec3(4, y, 4));
        scene.start(testPlatform());
        expectError([&] { scene.integrator.step(1); },
                    {"SlipChannel: particle 0 (body 0) has its centre at y = ",
                     "with walls at y = 1 and 6.5 nm", "nearer to a wall than its radius, 0.8 nm",
                     "setWallRejection(Crossing)"});
        scene.integrator.setWallRejection(RigidHI::Crossing);
        scene.integrator.step(1);
        scene.pose({Vec3(4, y < 4 ? 0.9 : 6.6, 4)}, {{1, 0, 0, 0}});
        expectError([&] { scene.integrator.step(1); },
                    {"where a particle (this one of radius 0.8 nm) has no mobility"});
    }
}

TEST(Channel, BoxesThatDoNotHoldItAreRefused) {
    ChannelScene scene;
    scene.addBodies();
    scene.start(testPlatform());
    scene.integrator.step(1);
    scene.context->setPeriodicBoxVectors(Vec3(9, 0, 0), Vec3(0, 5.5, 0), Vec3(0, 0, 9));
    expectError([&] { scene.integrator.step(1); },
                {"SlipChannel needs a periodic box whose y edge is longer than the channel is wide",
                 "5.5 nm", "walls are at 1 and 6.5 nm", "setChannelWalls()"});
    scene.context->setPeriodicBoxVectors(Vec3(9, 0, 0), Vec3(1, 9, 0), Vec3(0, 0, 9));
    expectError([&] { scene.integrator.step(1); },
                {"SlipChannel needs a periodic box ",
                 "with edges along the axes, but the box has the vectors ", "(1, 9, 0)"});
    scene.context->setPeriodicBoxVectors(Vec3(9, 0, 0), Vec3(0, 5.6, 0), Vec3(0, 0, 9));
    scene.integrator.step(1);
}

TEST(Channel, WhatIsNotThereIsRefused) {
    MobilityForce fluid;
    const double nan = numeric_limits<double>::quiet_NaN();
    const vector<pair<double, double>> bad = {
        {1, 1}, {2, 1}, {nan, 1}, {0, numeric_limits<double>::infinity()}};
    for (const auto& [yLow, yHigh] : bad)
        expectError([&, yLow = yLow, yHigh = yHigh] { fluid.setChannelWalls(yLow, yHigh); },
                    {"setChannelWalls(): the walls are at ", "the first below the second",
                     "give the lower wall first"});
    for (auto model : {MobilityForce::RotnePragerYamakawa, MobilityForce::StokesianDynamics,
                       MobilityForce::FreeDraining}) {
        ChannelScene scene;
        scene.add(sphereKind(0.8), Vec3(4, 4, 4));
        scene.fluid->setModel(model);
        expectError([&] { scene.start(testPlatform()); },
                    {"boundary SlipChannel can be used with the model ForceCoupling"});
    }
    ChannelScene barostat;
    barostat.addBodies();
    barostat.system.addForce(new MonteCarloBarostat(1, 300));
    expectError([&] { barostat.start(testPlatform()); }, {"arostat"});
    ChannelScene changed;
    changed.addBodies();
    changed.start(testPlatform());
    changed.fluid->setChannelWalls(0.5, 6.5);
    expectError(
        [&] { changed.fluid->updateParametersInContext(*changed.context); },
        {"updateParametersInContext() cannot change the walls or the condition of a channel"});
    FluidScene none;
    none.fluid->setBoundary(MobilityForce::SlipChannel);
    none.fluid->setModel(MobilityForce::ForceCoupling);
    none.add(sphereKind(0.8), Vec3(4, 4, 4));
    expectError([&] { none.start(testPlatform()); },
                {"boundary SlipChannel has walls at y = 0 and 0 nm", "setChannelWalls()"});
}

TEST(Channel, EffectsNameTheWalls) {
    ChannelScene scene;
    scene.addBodies();
    scene.start(testPlatform());
    scene.integrator.step(1);
    const string text = scene.integrator.getEffects().at("hydrodynamics");
    for (const char* words :
         {"ForceCoupling between slip walls at y = 1 and 6.5 nm", "overlaps a wall"})
        EXPECT_NE(text.find(words), string::npos) << text;
}

TEST(Channel, StatisticsCountTheTimeOfProductsOnce) {
    ChannelScene scene(T1, RigidHI::DriftCorrectorFD, MobilityForce::MatrixFree);
    scene.fluid->setSolverTolerance(1e-4);
    scene.addBodies();
    scene.start(testPlatform());
    const auto start = chrono::steady_clock::now();
    scene.integrator.step(2);
    const double wall = chrono::duration<double>(chrono::steady_clock::now() - start).count();
    double sum = 0;
    for (const char* part :
         {"seconds_spreading", "seconds_fft", "seconds_averaging", "seconds_solver"}) {
        EXPECT_GT(scene.integrator.getStepStatistics().at(part), 0) << part;
        sum += scene.integrator.getStepStatistics().at(part);
    }
    EXPECT_LE(sum, wall);
}
