// Periodic Rotne-Prager-Yamakawa by pairs and waves in a Context: against lattice sums, boxes,
// noise, drift, resume.

#include <openmm/CustomExternalForce.h>

#include "HydrodynamicSupport.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

typedef CustomRigidHIIntegrator RigidHI;
const double T1 = 1 / boltzmann;  // the temperature with kT = 1
const RigidHI::Scheme schemes[] = {RigidHI::LangevinHI, RigidHI::DriftCorrectorRFD,
                                   RigidHI::TrapezoidalSlip};

struct SplitScene : FluidScene {
    explicit SplitScene(double temperature = 0, RigidHI::Scheme scheme = RigidHI::DriftCorrectorRFD,
                        double h = 0.002, MobilityForce::Solver solver = MobilityForce::MatrixFree,
                        double tolerance = 1e-2)
        : FluidScene(temperature, h) {
        fluid->setBoundary(MobilityForce::Periodic);
        fluid->setModel(MobilityForce::RotnePragerYamakawa);
        fluid->setSolver(solver);
        fluid->setSolverTolerance(tolerance);
        integrator.setScheme(scheme);
        side = 8;
    }
    /** Spheres, multiblobs and a free particle, pulled; across faces of the box and outside of it.
     */
    void addBodies() {
        add(sphereKind(1), Vec3(0, 0, 0));
        add(sphereKind(0.8), Vec3(2.1, 0.3, 8.2));
        add(boomerangKind(), Vec3(-1, 2.5, 2.4));
        add(boomerangKind(), Vec3(3.5, -2.5, 0.4));
        auto* pull = new CustomExternalForce("0.7*x-0.4*y+0.2*z*z");
        for (int i = 0; i < system.getNumParticles(); i++) pull->addParticle(i, vector<double>());
        system.addForce(pull);
    }
    double count(const string& what) const { return integrator.getStepStatistics().at(what); }
    string effect(const string& what) const { return integrator.getEffects().at(what); }
    void setBox(double x, double y, double z) {
        context->setPeriodicBoxVectors(Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z));
    }
};

/** Entries over the roots of the diagonal. */
double relativeError(const MatrixXd& N, const MatrixXd& exact) {
    const VectorXd root = exact.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd error = root.asDiagonal() * (N - exact) * root.asDiagonal();
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(error).eigenvalues().cwiseAbs().maxCoeff();
}

}  // namespace

TEST(RotnePragerYamakawaGrid, IsTheLatticeSumToTheTolerance) {
    SplitScene exact(0, RigidHI::DriftCorrectorRFD, 0.002, MobilityForce::Dense);
    exact.addBodies();
    exact.start(testPlatform());
    const MatrixXd N = exact.mobility();
    for (double tolerance : {1e-2, 1e-3, 1e-5}) {
        SplitScene scene(0, RigidHI::DriftCorrectorRFD, 0.002, MobilityForce::MatrixFree,
                         tolerance);
        scene.addBodies();
        scene.start(testPlatform());
        EXPECT_LE(relativeError(scene.mobility(), N), tolerance);
        EXPECT_NE(scene.effect("hydrodynamics").find(" on a grid of "), string::npos)
            << scene.effect("hydrodynamics");
    }
}

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

TEST(RotnePragerYamakawaGrid, TheBoxOfAStepIsThatOfTheContext) {
    for (auto scheme : schemes) {
        SplitScene changed(0.1 * T1, scheme), always(0.1 * T1, scheme);
        for (SplitScene* scene : {&changed, &always}) {
            scene->addBodies();
            scene->start(testPlatform());
        }
        changed.mobility();
        for (SplitScene* scene : {&changed, &always}) scene->setBox(7, 8.5, 9);
        changed.integrator.step(1);
        always.integrator.step(1);
        EXPECT_EQ(changed.state(), always.state());
        changed.setBox(9, 8, 7);
        changed.mobility();
        always.setBox(9, 8, 7);
        changed.integrator.step(1);
        always.integrator.step(1);
        EXPECT_EQ(changed.state(), always.state());
    }
}

TEST(RotnePragerYamakawaGrid, WhatItHasNotIsRefusedWithTheAlternative) {
    SplitScene scene;
    scene.addBodies();
    scene.start(testPlatform());
    scene.integrator.step(1);
    const VectorXd before = scene.state();
    scene.context->setPeriodicBoxVectors(Vec3(8, 0, 0), Vec3(1, 8, 0), Vec3(0, 0, 8));
    expectError([&] { scene.integrator.step(1); },
                {"RotnePragerYamakawa on a grid needs a box with edges along the axes", "(1, 8, 0)",
                 "setSolver(Dense)"});
    EXPECT_EQ(scene.state(), before);
    scene.setBox(8, 8, 8);
    scene.integrator.step(1);
    const auto withRadii = [](int number, MobilityForce::Solver solver) {
        auto made = make_unique<SplitScene>(0, RigidHI::EulerMaruyama, 0.002, solver);
        made->side = 30;
        for (int i = 0; i < number; i++)
            made->add(sphereKind(0.5 + 0.01 * i), Vec3(3 * (i % 9), 3 * (i / 9 % 9), 3 * (i / 81)));
        return made;
    };
    const auto many = withRadii(9, MobilityForce::MatrixFree);
    expectError([&] { many->start(testPlatform()); },
                {"RotnePragerYamakawa on a grid has 9 different radii", "may have 8",
                 "use setSolver(Dense), or fewer different radii by addParticle()"});
    withRadii(8, MobilityForce::MatrixFree)->start(testPlatform());
    // Auto has matrices where there are too many.
    const auto both = withRadii(30, MobilityForce::Auto);
    both->start(testPlatform());
    EXPECT_EQ(both->effect("hydrodynamics").find(" on a grid"), string::npos);
}

TEST(RotnePragerYamakawaGrid, ResumesBitForBit) {
    for (auto scheme : schemes) {
        const auto start = [&](int threads) {
            auto scene = make_unique<SplitScene>(T1, scheme);
            scene->addBodies();
            scene->start(testPlatform(), threads);
            return scene;
        };
        const auto toAnotherBox = [](SplitScene& scene) {
            scene.integrator.step(1);
            scene.setBox(8, 7.5, 9);
            scene.integrator.step(1);
        };
        expectToResumeBitForBit<SplitScene>(start, toAnotherBox, 2);
    }
}

TEST(RotnePragerYamakawaGrid, WithoutTemperatureNoFieldIsDrawn) {
    for (auto scheme : schemes) {
        SplitScene scene(0, scheme);
        scene.addBodies();
        scene.start(testPlatform());
        scene.integrator.step(2);
        EXPECT_EQ(scene.count("randomNumbers"), 0);
        EXPECT_EQ(scene.count("squareRoots"), 0);
    }
}

/** Of the field the part of pairs is a square root, which the drift-corrector takes at the start,
 * displaced, and at the mid-point. */
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
        // One for each row of spheres and blobs, and those of waves.
        EXPECT_GT(scene.count("randomNumbers"), 2 * 6 + (scene.system.getNumParticles() - 2) * 3);
    }
}

TEST(RotnePragerYamakawaGrid, SpheresAloneHaveNoDrift) {
    // nu = 1, and one product: what SlipOnly and Whole do is the same.
    VectorXd ends[2];
    for (auto scaling : {RigidHI::SlipOnly, RigidHI::Whole}) {
        SplitScene scene(T1);
        for (int i = 0; i < 3; i++) scene.add(sphereKind(0.8), Vec3(2.1 * i, 0.3, 0.2 * i));
        scene.integrator.setDriftCorrectorScaling(scaling);
        scene.start(testPlatform());
        scene.integrator.step(2);
        EXPECT_EQ(scene.count("mobilityProducts"), 2);
        EXPECT_EQ(scene.count("squareRoots"), 2);
        EXPECT_EQ(scene.effect("stochastic drift").substr(0, 3), "off");
        ends[scaling] = scene.state();
    }
    EXPECT_EQ(ends[0], ends[1]);
}

TEST(RotnePragerYamakawaGrid, GroupsShareAGridAndNoNoise) {
    // Two groups of the same bodies at the same places: the same mobility, no interaction, other
    // noise.
    SplitScene scene(T1);
    for (int i = 0; i < 2; i++) {
        scene.add(sphereKind(0.8), Vec3(0, 0, 0));
        scene.add(boomerangKind(), Vec3(-1, 2.5, 2.4));
    }
    scene.fluid->setGroups({0, 0, 1, 1});
    scene.start(testPlatform());
    const MatrixXd N = scene.mobility();
    EXPECT_EQ(MatrixXd(N.topLeftCorner(12, 12)), MatrixXd(N.bottomRightCorner(12, 12)));
    EXPECT_EQ(N.topRightCorner(12, 12).norm(), 0);
    const auto before = scene.integrator.getBodyPositions();
    scene.integrator.step(1);
    const auto after = scene.integrator.getBodyPositions();
    EXPECT_GT(toEigen(after[0] - before[0] - (after[2] - before[2])).norm(),
              0.1 * toEigen(after[0] - before[0]).norm());
}

TEST(RotnePragerYamakawaGrid, LangevinHITakesTheStepOfMatrices) {
    // Same seed, same step: in the norm of mass-weighted momenta to five tolerances, as for all
    // matrix-free fluids.
    for (double temperature : {0.0, T1}) {
        const auto velocities = [&](MobilityForce::Solver solver, double tolerance) {
            SplitScene scene(temperature, RigidHI::LangevinHI, 0.05, solver, tolerance);
            scene.addBodies();
            scene.start(testPlatform());
            scene.integrator.step(1);
            const auto V = scene.integrator.getBodyVelocities();
            VectorXd all(3 * V.size());
            for (size_t b = 0; b < V.size(); b++)
                all.segment<3>(3 * b) = sqrt(scene.bodies[b].mass) * toEigen(V[b]);
            return all;
        };
        const VectorXd exact = velocities(MobilityForce::Dense, 1e-6);
        for (double tolerance : {1e-2, 1e-4}) {
            const VectorXd error = velocities(MobilityForce::MatrixFree, tolerance) - exact;
            EXPECT_LE(error.norm(), 5 * tolerance * exact.norm())
                << temperature << " " << tolerance;
        }
    }
}
