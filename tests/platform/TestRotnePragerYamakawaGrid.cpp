// Periodic Rotne-Prager-Yamakawa by pairs and waves in a Context. TestPeriodicGrids has the tests
// that every model on a grid must pass.

#include "GridSceneSupport.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;

struct SplitScene : GridScene {
    explicit SplitScene(double temperature = 0, RigidHI::Scheme scheme = RigidHI::DriftCorrectorRFD,
                        double h = 0.002, MobilityForce::Solver solver = MobilityForce::MatrixFree,
                        double tolerance = 1e-2)
        : GridScene(MobilityForce::RotnePragerYamakawa, temperature, scheme, h, solver, tolerance) {
    }
};

}  // namespace

TEST(RotnePragerYamakawaGrid, TheSpacingOfTheUserKeepsTheTolerance) {
    SplitScene exact(0, RigidHI::DriftCorrectorRFD, 0.002, MobilityForce::Dense);
    exact.addBodies();
    exact.start(testPlatform());
    const MatrixXd N = exact.mobility();
    for (const auto& [spacing, nodes] :
         map<double, string>{{0.5, "16 x 16 x 16"}, {0.8, "10 x 10 x 10"}, {100, "2 x 2 x 2"}}) {
        SplitScene scene(0, RigidHI::DriftCorrectorRFD, 0.002, MobilityForce::MatrixFree, 1e-3);
        scene.addBodies();
        scene.fluid->setGridSpacing(spacing);
        scene.start(testPlatform());
        EXPECT_NE(scene.effect("hydrodynamics").find(nodes), string::npos)
            << scene.effect("hydrodynamics");
        EXPECT_LE(relativeError(scene.mobility(), N), 1e-3);
    }
}

TEST(RotnePragerYamakawaGrid, WhatItHasNotIsRefusedWithTheAlternative) {
    const auto withRadii = [](int number, MobilityForce::Solver solver) {
        auto made = make_unique<SplitScene>(0, RigidHI::EulerMaruyama, 0.002, solver);
        made->side = 30;
        for (int i = 0; i < number; i++)
            made->add(sphereKind(0.5 + 0.01 * i), Vec3(3 * (i % 9), 3 * (i / 9 % 9), 3 * (i / 81)));
        return made;
    };
    const auto many = withRadii(9, MobilityForce::MatrixFree);
    expectError([&] { many->start(testPlatform()); },
                {"RotnePragerYamakawa on a grid has 9 different radii", "may have at most 8",
                 "use setSolver(Dense), or fewer different radii by addParticle()"});
    withRadii(8, MobilityForce::MatrixFree)->start(testPlatform());
    // With too many different radii the solver Auto uses matrices.
    const auto both = withRadii(30, MobilityForce::Auto);
    both->start(testPlatform());
    EXPECT_EQ(both->effect("hydrodynamics").find(" on a grid"), string::npos);
}

/**
 * The part of the field that belongs to pairs is a square root. The drift corrector takes this root
 * at the start, at the displaced poses, and at the mid-point.
 */
TEST(RotnePragerYamakawaGrid, SchemesTakeTheirNoiseFromTheField) {
    const map<RigidHI::Scheme, int> roots = {{RigidHI::EulerMaruyama, 1},
                                             {RigidHI::RandomFiniteDifference, 1},
                                             {RigidHI::TractionEulerMaruyama, 1},
                                             {RigidHI::TrapezoidalSlip, 1},
                                             {RigidHI::DriftCorrectorRFD, 3}};
    for (const auto& [scheme, count] : roots) {
        SCOPED_TRACE(traitsOf(scheme).name);
        SplitScene scene(T1, scheme);
        scene.addBodies();
        scene.start(testPlatform());
        scene.integrator.step(1);
        EXPECT_EQ(scene.count("squareRoots"), count);
        // There is one random number for each row of spheres and blobs, and there are those of the
        // waves.
        EXPECT_GT(scene.count("randomNumbers"), 2 * 6 + (scene.system.getNumParticles() - 2) * 3);
    }
}

TEST(RotnePragerYamakawaGrid, PairsThatNoMachineHoldsAreRefusedBeforeTheyAreMade) {
    // With so coarse a grid nearly the whole mobility is in the sums over pairs.
    SplitScene scene(0, RigidHI::EulerMaruyama, 0.002, MobilityForce::MatrixFree, 1e-6);
    scene.side = 200;
    for (int i = 0; i < 64000; i++)
        scene.add(sphereKind(0.5), Vec3(5 * (i % 40), 5 * (i / 40 % 40), 5 * (i / 1600)));
    scene.fluid->setGridSpacing(100);
    scene.start(testPlatform());
    expectError([&] { scene.integrator.step(1); },
                {"RotnePragerYamakawa on a grid needs ", " GB of memory, most of it for the ",
                 " neighbours of each particle within a gap of ",
                 " GB are free; lower setGridSpacing() or set it to 0 (chosen by the solver "
                 "tolerance), raise setSolverTolerance(), or simulate fewer particles"});
}
