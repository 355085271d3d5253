// Periodic fluids on a grid in a Context, for every model: products against lattice sums, changes
// of the box, noise, drift, and exact resume.

#include "GridSceneSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;

struct GridModel {
    const char* name;
    MobilityForce::Model model;
    RigidHI::Scheme driftCorrector;
    int rootsOfField;  // square roots for the draw of a field, besides the part on the grid
};
const GridModel models[] = {
    {"ForceCoupling", MobilityForce::ForceCoupling, RigidHI::DriftCorrectorFD, 0},
    {"RotnePragerYamakawa", MobilityForce::RotnePragerYamakawa, RigidHI::DriftCorrectorRFD, 1}};

class PeriodicGrid : public testing::TestWithParam<GridModel> {
protected:
    unique_ptr<GridScene> make(double temperature, RigidHI::Scheme scheme, double h = 0.002,
                               MobilityForce::Solver solver = MobilityForce::MatrixFree,
                               double tolerance = 0.05) const {
        return make_unique<GridScene>(GetParam().model, temperature, scheme, h, solver, tolerance);
    }
    vector<RigidHI::Scheme> schemes() const {
        return {RigidHI::LangevinHI, GetParam().driftCorrector, RigidHI::TrapezoidalSlip};
    }
};
INSTANTIATE_TEST_SUITE_P(Models, PeriodicGrid, testing::ValuesIn(models),
                         [](const testing::TestParamInfo<GridModel>& info) {
                             return info.param.name;
                         });

/** Spheres at the nodes of a lattice of this spacing, in a cube. */
void addLattice(GridScene& scene, int edge, double spacing) {
    scene.side = edge * spacing;
    for (int i = 0; i < edge * edge * edge; i++)
        scene.add(sphereKind(1), spacing * Vec3(i % edge, i / edge % edge, i / (edge * edge)));
}
/** Boomerangs likewise. */
void addBoomerangs(GridScene& scene, int edge, double spacing) {
    scene.side = edge * spacing;
    for (int i = 0; i < edge * edge * edge; i++)
        scene.add(boomerangKind(), spacing * Vec3(i % edge, i / edge % edge, i / (edge * edge)));
}
bool isOnGrid(const GridScene& scene) {
    return scene.effect("hydrodynamics").find(" on a grid of ") != string::npos;
}

}  // namespace

TEST_P(PeriodicGrid, IsTheLatticeSumToTheTolerance) {
    const auto started = [&](MobilityForce::Solver solver, double tolerance) {
        auto scene = make(0, GetParam().driftCorrector, 0.002, solver, tolerance);
        scene->addBodies();
        scene->start(testPlatform());
        return scene;
    };
    const MatrixXd N = started(MobilityForce::Dense, 1e-6)->mobility();
    for (double tolerance : {1e-2, 1e-3, 1e-5}) {
        const auto scene = started(MobilityForce::MatrixFree, tolerance);
        EXPECT_LE(relativeError(scene->mobility(), N), tolerance);
        EXPECT_NE(scene->effect("hydrodynamics").find(" on a grid of "), string::npos)
            << scene->effect("hydrodynamics");
    }
}

TEST_P(PeriodicGrid, TheBoxOfAStepIsThatOfTheContext) {
    for (auto scheme : schemes()) {
        const auto changed = make(0.1 * T1, scheme), always = make(0.1 * T1, scheme);
        for (GridScene* scene : {changed.get(), always.get()}) {
            scene->addBodies();
            scene->start(testPlatform());
        }
        changed->mobility();
        for (GridScene* scene : {changed.get(), always.get()}) scene->setBox(7, 8.5, 9);
        changed->integrator.step(1);
        always->integrator.step(1);
        EXPECT_EQ(changed->state(), always->state());
        changed->setBox(9, 8, 7);
        changed->mobility();
        always->setBox(9, 8, 7);
        changed->integrator.step(1);
        always->integrator.step(1);
        EXPECT_EQ(changed->state(), always->state());
    }
}

TEST_P(PeriodicGrid, TriclinicBoxesHaveTheLatticeSumToTheTolerance) {
    const auto started = [&](MobilityForce::Solver solver, double tolerance) {
        auto scene = make(0, GetParam().driftCorrector, 0.002, solver, tolerance);
        scene->addBodies();
        scene->start(testPlatform());
        scene->integrator.step(1);
        scene->context->setPeriodicBoxVectors(Vec3(8, 0, 0), Vec3(-3.5, 8, 0), Vec3(2, 3, 9));
        return scene;
    };
    const MatrixXd N = started(MobilityForce::Dense, 1e-6)->mobility();
    for (double tolerance : {1e-2, 1e-3})
        EXPECT_LE(relativeError(started(MobilityForce::MatrixFree, tolerance)->mobility(), N),
                  tolerance);
}

TEST_P(PeriodicGrid, AutoTakesAGridInSkewBoxesToo) {
    for (double shear : {0.0, 1.5}) {
        const auto scene = make(0, GetParam().driftCorrector, 0.002, MobilityForce::Auto);
        scene->side = 12;
        scene->shear = shear;
        for (int i = 0; i < 64; i++)
            scene->add(sphereKind(1), Vec3(3 * (i % 4), 3 * (i / 4 % 4), 3 * (i / 16)));
        scene->start(testPlatform());
        scene->integrator.step(1);
        EXPECT_NE(scene->effect("hydrodynamics").find(" on a grid"), string::npos)
            << scene->effect("hydrodynamics");
    }
}

TEST_P(PeriodicGrid, AutoTakesTheFasterOfMatricesAndAGrid) {
    const bool isForceCoupling = GetParam().model == MobilityForce::ForceCoupling;
    const auto chooses = [&](RigidHI::Scheme scheme, double tolerance,
                             const function<void(GridScene&)>& addAll) {
        const auto scene = make(0, scheme, 0.002, MobilityForce::Auto, tolerance);
        addAll(*scene);
        scene->start(testPlatform());
        const string text = scene->effect("hydrodynamics");
        EXPECT_NE(text.find("chosen by Auto: a step is estimated to take "), string::npos) << text;
        EXPECT_NE(text.find(" s with matrices and "), string::npos) << text;
        return isOnGrid(*scene);
    };
    const auto crowded = [](GridScene& scene) { addLattice(scene, 4, 3); };
    EXPECT_TRUE(chooses(RigidHI::EulerMaruyama, 1e-3, crowded));
    // In a dilute suspension force coupling needs too many nodes. Pairs and waves need few.
    EXPECT_EQ(
        chooses(RigidHI::EulerMaruyama, 1e-3, [](GridScene& scene) { addLattice(scene, 4, 20); }),
        !isForceCoupling);
    // LangevinHI of multiblobs takes the iterations of a root times those of a solve.
    const auto multiblobs = [](GridScene& scene) { addBoomerangs(scene, 3, 4); };
    EXPECT_FALSE(chooses(RigidHI::LangevinHI, 1e-6, multiblobs));
    EXPECT_TRUE(chooses(GetParam().driftCorrector, 1e-3, multiblobs));
}

/** Matrices of few rows have no grid error. DriftCorrectorFD makes twelve of them for each body. */
TEST_P(PeriodicGrid, AutoLeavesMatricesOfFewRowsWhereTheyAreFarSlower) {
    const auto scene = make(0, RigidHI::EulerMaruyama, 0.002, MobilityForce::Auto, 1e-3);
    addBoomerangs(*scene, 2, 5);
    scene->start(testPlatform());
    scene->integrator.step(1);
    EXPECT_FALSE(isOnGrid(*scene)) << scene->effect("hydrodynamics");
    EXPECT_EQ(scene->effect("hydrodynamics").find("chosen by Auto"), string::npos);
    scene->integrator.setScheme(RigidHI::DriftCorrectorFD);
    scene->integrator.setTemperature(T1);
    scene->integrator.step(1);
    EXPECT_TRUE(isOnGrid(*scene)) << scene->effect("hydrodynamics");
    EXPECT_NE(scene->effect("hydrodynamics").find("chosen by Auto"), string::npos);
    scene->integrator.setScheme(RigidHI::RandomFiniteDifference);
    scene->integrator.step(1);
    EXPECT_FALSE(isOnGrid(*scene)) << scene->effect("hydrodynamics");
}

TEST_P(PeriodicGrid, AutoDecidesByRowsWhereTheSystemHasNoBoxOrASpacingIsGiven) {
    // Nobody sets OpenMM's default box, or a spacing of nodes asks for a grid.
    for (double spacing : {0.0, 1.0}) {
        const auto scene = make(0, RigidHI::EulerMaruyama, 0.002, MobilityForce::Auto, 1e-3);
        addLattice(*scene, 4, 20);
        if (spacing == 0)
            scene->side = 2;
        else
            scene->fluid->setGridSpacing(spacing / 4);
        scene->start(testPlatform());
        scene->setBox(80, 80, 80);
        EXPECT_TRUE(isOnGrid(*scene)) << scene->effect("hydrodynamics");
        EXPECT_EQ(scene->effect("hydrodynamics").find("chosen by Auto"), string::npos);
    }
}

TEST_P(PeriodicGrid, AutoChoosesAnewForAnotherSchemeAndResumesBitForBit) {
    // Half of the steps are by a scheme that takes a grid, the rest by one that takes matrices. The
    // box of the Context changes nothing.
    const auto start = [&](RigidHI::Scheme scheme) {
        // Pairs and waves are slower than matrices at a fine tolerance only.
        const double tolerance = GetParam().model == MobilityForce::ForceCoupling ? 1e-3 : 1e-6;
        auto scene = make(T1, scheme, 0.0005, MobilityForce::Auto, tolerance);
        addBoomerangs(*scene, 3, 4);
        scene->start(testPlatform());
        return scene;
    };
    const auto once = start(GetParam().driftCorrector), other = start(RigidHI::LangevinHI);
    EXPECT_TRUE(isOnGrid(*once));
    once->integrator.step(1);
    once->setBox(13, 12, 12.5);
    once->integrator.step(1);
    EXPECT_TRUE(isOnGrid(*once));
    once->integrator.setScheme(RigidHI::LangevinHI);
    once->integrator.step(1);
    EXPECT_FALSE(isOnGrid(*once)) << once->effect("hydrodynamics");
    stringstream checkpoint, xml;
    saveState(*once->context, checkpoint, xml);
    once->integrator.step(2);
    other->context->loadCheckpoint(checkpoint);
    other->integrator.step(2);
    EXPECT_FALSE(isOnGrid(*other));
    EXPECT_EQ(other->state(), once->state());
}

TEST_P(PeriodicGrid, ResumesBitForBit) {
    for (auto scheme : schemes()) {
        const auto start = [&](int threads) {
            auto scene = make(T1, scheme);
            scene->addBodies();
            scene->start(testPlatform(), threads);
            return scene;
        };
        const auto toAnotherBox = [](GridScene& scene) {
            scene.integrator.step(1);
            scene.setBox(8, 7.5, 9);
            scene.integrator.step(1);
        };
        expectToResumeBitForBit<GridScene>(start, toAnotherBox, 1);
    }
}

TEST_P(PeriodicGrid, WithoutTemperatureNoFieldIsDrawn) {
    for (auto scheme : schemes()) {
        const auto scene = make(0, scheme);
        scene->addBodies();
        scene->start(testPlatform());
        scene->integrator.step(2);
        EXPECT_EQ(scene->count("randomNumbers"), 0);
        EXPECT_EQ(scene->count("squareRoots"), 0);
    }
}

TEST_P(PeriodicGrid, SpheresAloneHaveNoDrift) {
    // Here nu = 1, and a step has one product. So SlipOnly and Whole do the same.
    VectorXd ends[2];
    for (auto scaling : {RigidHI::SlipOnly, RigidHI::Whole}) {
        const auto scene = make(T1, GetParam().driftCorrector);
        for (int i = 0; i < 3; i++) scene->add(sphereKind(0.8), Vec3(2.1 * i, 0.3, 0.2 * i));
        scene->integrator.setDriftCorrectorScaling(scaling);
        scene->start(testPlatform());
        scene->integrator.step(2);
        EXPECT_EQ(scene->count("mobilityProducts"), 2);
        EXPECT_EQ(scene->count("squareRoots"), 2 * GetParam().rootsOfField);
        EXPECT_EQ(scene->effect("stochastic drift").substr(0, 3), "off");
        ends[scaling] = scene->state();
    }
    EXPECT_EQ(ends[0], ends[1]);
}

TEST_P(PeriodicGrid, GroupsShareAGridAndNoNoise) {
    // Two groups of the same bodies at the same places have the same mobility, no interaction, and
    // different noise.
    const auto scene = make(T1, GetParam().driftCorrector);
    for (int i = 0; i < 2; i++) {
        scene->add(sphereKind(0.8), Vec3(0, 0, 0));
        scene->add(boomerangKind(), Vec3(-1, 2.5, 2.4));
    }
    scene->fluid->setGroups({0, 0, 1, 1});
    scene->start(testPlatform());
    const MatrixXd N = scene->mobility();
    EXPECT_EQ(MatrixXd(N.topLeftCorner(12, 12)), MatrixXd(N.bottomRightCorner(12, 12)));
    EXPECT_EQ(N.topRightCorner(12, 12).norm(), 0);
    const auto before = scene->integrator.getBodyPositions();
    scene->integrator.step(1);
    const auto after = scene->integrator.getBodyPositions();
    EXPECT_GT(toEigen(after[0] - before[0] - (after[2] - before[2])).norm(),
              0.1 * toEigen(after[0] - before[0]).norm());
}

TEST_P(PeriodicGrid, LangevinHITakesTheStepOfMatrices) {
    // A step with the same seed agrees to five tolerances in the norm of mass-weighted momenta, as
    // for all matrix-free fluids.
    for (double temperature : {0.0, T1}) {
        const auto velocities = [&](MobilityForce::Solver solver, double tolerance) {
            const auto scene = make(temperature, RigidHI::LangevinHI, 0.05, solver, tolerance);
            scene->addBodies();
            scene->start(testPlatform());
            scene->integrator.step(1);
            const auto V = scene->integrator.getBodyVelocities();
            VectorXd all(3 * V.size());
            for (size_t b = 0; b < V.size(); b++)
                all.segment<3>(3 * b) = sqrt(scene->bodies[b].mass) * toEigen(V[b]);
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
