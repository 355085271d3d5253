// Steps of force coupling beside no-slip walls and in films, on a grid: all schemes that use random
// fields, threads, platforms, the text of describeEffects(), and the available solvers.

#include <openmm/CustomExternalForce.h>

#include "HydrodynamicSupport.h"
#include "Instrumented.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

const MobilityForce::Boundary boundaries[] = {MobilityForce::PeriodicWall,
                                              MobilityForce::NoSlipChannel, MobilityForce::Film};

/** Two boomerangs, a sphere and a free particle, near the lower wall. */
void build(FluidScene& scene, MobilityForce::Boundary boundary,
           CustomRigidHIIntegrator::Scheme scheme) {
    scene.fluid->setModel(MobilityForce::ForceCoupling);
    scene.fluid->setBoundary(boundary);
    scene.fluid->setWallHeight(-2.6);
    scene.fluid->setChannelWalls(-2.6, 3.5);
    scene.fluid->setSolverTolerance(1e-2);
    scene.integrator.setScheme(scheme);
    scene.side = 9;
    scene.add(boomerangKind(), Vec3(1, 1, 0));
    scene.add(sphereKind(0.7), Vec3(-3, 2, -1.5));
    scene.addFree(1, 0.6, Vec3(-2, -2, 0.4));
}
VectorXd after(const string& platformName, int threadCount, MobilityForce::Boundary boundary,
               CustomRigidHIIntegrator::Scheme scheme, int steps) {
    FluidScene scene(300, 1e-3);
    build(scene, boundary, scheme);
    scene.start(platform(platformName), threadCount);
    scene.integrator.step(steps);
    return scene.state();
}

}  // namespace

TEST(ConfinedForceCoupling, SchemesStepAlikeOnAllThreadsAndPlatforms) {
    if (!onCpu()) GTEST_SKIP() << "the program of the platform CPU compares the two";
    for (auto boundary : boundaries)
        for (auto scheme :
             {CustomRigidHIIntegrator::LangevinHI, CustomRigidHIIntegrator::EulerMaruyama,
              CustomRigidHIIntegrator::TrapezoidalSlip,
              CustomRigidHIIntegrator::DriftCorrectorFD}) {
            const int steps =
                scheme == CustomRigidHIIntegrator::TrapezoidalSlip ? allOrFew(2, 1) : 1;
            const VectorXd one = after("CPU", 1, boundary, scheme, steps),
                           two = after("CPU", 2, boundary, scheme, steps);
            EXPECT_TRUE(one.allFinite());
            EXPECT_TRUE(one == two) << boundaryTable[boundary].name << ", " << scheme;
            if (boundary != MobilityForce::NoSlipChannel || isInstrumented()) continue;
            const VectorXd plain = after("Reference", 1, boundary, scheme, steps);
            // Solves and roots go to their tolerance, and products of both in other precisions.
            EXPECT_LE((plain - one).norm(), 1e-3 * one.norm()) << scheme;
        }
}

TEST(ConfinedForceCoupling, EffectsDescribeTheGridAndItsPlanes) {
    FluidScene scene;
    build(scene, MobilityForce::NoSlipChannel, CustomRigidHIIntegrator::TrapezoidalSlip);
    scene.start(testPlatform());
    const string effects = scene.integrator.getEffects().at("hydrodynamics");
    for (const char* part : {"ForceCoupling between no-slip walls at z = -2.6 and 3.5 nm",
                             "on a grid of ", "with planes in a period of 7.5 nm"})
        EXPECT_NE(effects.find(part), string::npos) << part << " in " << effects;
}

TEST(ConfinedForceCoupling, AnySolverGivesTheSameMobility) {
    for (auto boundary : boundaries) {
        MatrixXd N[3];
        for (auto solver : {MobilityForce::Auto, MobilityForce::Dense, MobilityForce::MatrixFree}) {
            FluidScene scene;
            build(scene, boundary, CustomRigidHIIntegrator::EulerMaruyama);
            scene.fluid->setSolver(solver);
            scene.fluid->setGridSpacing(0.25);
            scene.fluid->setSolverTolerance(1e-8);
            scene.start(testPlatform());
            N[solver] = scene.mobility();
        }
        EXPECT_LE(difference(N[MobilityForce::MatrixFree], N[MobilityForce::Dense]), 1e-6);
        EXPECT_LE(difference(N[MobilityForce::Auto], N[MobilityForce::Dense]), 1e-6);
    }
}

TEST(ConfinedForceCoupling, EffectsStateTheCostOfMatrices) {
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
        FluidScene scene;
        build(scene, MobilityForce::PeriodicWall, CustomRigidHIIntegrator::TrapezoidalSlip);
        scene.fluid->setSolver(solver);
        scene.start(testPlatform());
        const string effects = scene.integrator.getEffects().at("hydrodynamics");
        for (const char* part : {" rows, ", " MB, and is estimated to take ",
                                 " s on one thread, by a product on the grid for each row"})
            EXPECT_EQ(effects.find(part) != string::npos, solver == MobilityForce::Dense)
                << part << " in " << effects;
    }
}

TEST(ConfinedForceCoupling, FlowsAreAtRestOnWalls) {
    for (auto boundary : boundaries) {
        FluidScene scene(300, 1e-3);
        build(scene, boundary, CustomRigidHIIntegrator::EulerMaruyama);
        scene.integrator.setTemperature(0);
        auto* force = new OpenMM::CustomExternalForce("-(x + 2 * z)");
        for (int i = 0; i < scene.system.getNumParticles(); i++) force->addParticle(i);
        scene.system.addForce(force);
        scene.start(testPlatform());
        scene.integrator.step(1);
        const vector<Vec3> flow = scene.fluid->getFlowInContext(
            *scene.context, {Vec3(0, 0, -2.6), Vec3(2, 1, -2.6), Vec3(0, 0, -1.8)});
        EXPECT_GT(norm(flow[2]), 0.01);
        EXPECT_LE(max(norm(flow[0]), norm(flow[1])), 1e-2 * norm(flow[2]));
    }
}

TEST(ConfinedForceCoupling, MeansAndModesAreThoseOfTheFlowAtPoints) {
    // Nodes of Gauss and Legendre for the mean over the height, and equal steps along the planes.
    const double nodes[] = {0.0950125098376374, 0.2816035507792589, 0.4580167776572274,
                            0.6178762444026438, 0.7554044083550030, 0.8656312023878318,
                            0.9445750230732326, 0.9894009349916499},
                 weights[] = {0.1894506104550685, 0.1826034150449236, 0.1691565193950025,
                              0.1495959888165767, 0.1246289712555339, 0.0951585116824928,
                              0.0622535239386479, 0.0271524594117541};
    const pair<MobilityForce::Boundary, bool> cases[] = {{MobilityForce::NoSlipChannel, false},
                                                         {MobilityForce::NoSlipChannel, true},
                                                         {MobilityForce::Film, true}};
    for (const auto& [boundary, touching] : cases) {
        SCOPED_TRACE(string(boundaryTable[boundary].name) + (touching ? ", touching" : ""));
        FluidScene scene(300, 1e-3);
        const double low = -0.5, high = 4.5, accuracy = 1e-3;
        scene.integrator.setScheme(CustomRigidHIIntegrator::DriftCorrectorFD);
        scene.fluid->setModel(MobilityForce::ForceCoupling);
        scene.fluid->setBoundary(boundary);
        scene.fluid->setChannelWalls(low, high);
        scene.fluid->setSolverTolerance(accuracy);
        scene.fluid->setSinusoidalForceDensity(2, 0, 1, 1);
        scene.side = 6;
        // Envelopes of spheres that touch a plane reach through it.
        scene.add(sphereKind(1), Vec3(0, 0, touching ? low + 1 : 1.5));
        scene.add(sphereKind(1), Vec3(3, 2, touching ? high - 1 : 2.5));
        scene.start(testPlatform());
        scene.integrator.step(1);
        const int along = 24;
        vector<Vec3> points;
        vector<double> parts;
        for (int node = 0; node < 16; node++) {
            const double s = node < 8 ? -nodes[node] : nodes[node - 8],
                         z = 0.5 * (low + high + (high - low) * s);
            for (int i = 0; i < along * along; i++) {
                points.push_back(
                    Vec3(i % along * scene.side / along, i / along * scene.side / along, z));
                parts.push_back(0.5 * weights[node % 8] / (along * along));
            }
        }
        const vector<Vec3> flow = scene.fluid->getFlowInContext(*scene.context, points);
        Vec3 mean;
        double sine = 0, cosine = 0, size = 0;
        for (size_t p = 0; p < points.size(); p++) {
            const double angle = 2 * M_PI * points[p][1] / scene.side;
            mean += flow[p] * parts[p];
            sine += 2 * parts[p] * flow[p][0] * sin(angle);
            cosine += 2 * parts[p] * flow[p][0] * cos(angle);
            size += parts[p] * flow[p].dot(flow[p]);
        }
        // The flow at points has the error of the grid.
        const double tolerance = accuracy * sqrt(size);
        const Vec3 found = scene.fluid->getMeanFlowInContext(*scene.context);
        for (int k = 0; k < 3; k++) EXPECT_NEAR(found[k], mean[k], tolerance);
        const vector<double> mode = scene.fluid->getFlowModeInContext(*scene.context, 0, 1, 1);
        EXPECT_NEAR(mode[0], sine, tolerance);
        EXPECT_NEAR(mode[1], cosine, tolerance);
        EXPECT_GT(hypot(mode[0], mode[1]), 10 * tolerance);
    }
}
