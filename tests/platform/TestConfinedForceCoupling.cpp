// Steps of force coupling beside no-slip walls and in films, on a grid: all schemes that use random
// fields, threads, platforms, what describeEffects() says, and which solvers there are.

#include <openmm/CustomExternalForce.h>

#include "HydrodynamicSupport.h"
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
               CustomRigidHIIntegrator::Scheme scheme, int steps = 2) {
    FluidScene scene(300, 1e-3);
    build(scene, boundary, scheme);
    scene.start(platform(platformName), threadCount);
    scene.integrator.step(steps);
    return scene.state();
}

}  // namespace

TEST(ConfinedForceCoupling, SchemesStepAlikeOnAllThreadsAndPlatforms) {
    for (auto boundary : boundaries)
        for (auto scheme :
             {CustomRigidHIIntegrator::LangevinHI, CustomRigidHIIntegrator::EulerMaruyama,
              CustomRigidHIIntegrator::TrapezoidalSlip,
              CustomRigidHIIntegrator::DriftCorrectorFD}) {
            const VectorXd one = after("CPU", 1, boundary, scheme),
                           two = after("CPU", 2, boundary, scheme);
            EXPECT_TRUE(one.allFinite());
            EXPECT_TRUE(one == two) << boundaryTable[boundary].name << ", " << scheme;
            if (boundary != MobilityForce::NoSlipChannel) continue;
            const VectorXd plain = after("Reference", 1, boundary, scheme);
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
