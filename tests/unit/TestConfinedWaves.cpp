// Rotne-Prager-Yamakawa beside walls on a grid agrees with the matrix of the same fluid.

#include <Eigen/Dense>
#include <random>

#include "GridFluidSupport.h"
#include "Instrumented.h"
#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawaGrid.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

const double eta = 0.7;

enum Fluid { Wall, Channel, ClosedChannel };
const double low = -3.1;

ConfiningPlanes planesOf(Fluid fluid, double height = 5, bool crossing = false) {
    MobilityForce force;
    force.setBoundary(fluid == Wall ? MobilityForce::PeriodicWall : MobilityForce::NoSlipChannel);
    force.setWallHeight(low);
    force.setChannelWalls(low, low + height);
    if (fluid == ClosedChannel) force.setChannelCondition(MobilityForce::ZeroFlux);
    return ConfiningPlanes(force, crossing);
}

/** Particles of three radii, with torque or without, some of which touch walls or overlap. */
struct Scene {
    HydrodynamicParticles particles;
    Placement placement;

    Scene(int number, double height, unsigned seed, const vector<double>& radii = {1, 0.7, 0.85}) {
        mt19937 random(seed);
        uniform_real_distribution<double> uniform(0, 1);
        placement.box = {Vec3(7, 0, 0), Vec3(0, 9, 0), Vec3(0, 0, 3)};
        for (int i = 0; i < number; i++) {
            const double a = radii[i % radii.size()], range = height - 2 * a;
            particles.add(a, i % 2 == 0, i, i);
            const double z = i % 5 == 0 ? a : i % 5 == 1 ? height - a : a + range * uniform(random);
            placement.positions.push_back(
                Vec3(15 * uniform(random) - 4, 15 * uniform(random) - 4, low + z));
        }
    }
};

MatrixXd exactOf(const Scene& scene, const ConfiningPlanes& planes) {
    MatrixXd M;
    ConfinedRotnePragerYamakawa(scene.particles, eta, planes).at(scene.placement)->dense(M);
    return M;
}

MatrixXd onGrid(const Scene& scene, const ConfiningPlanes& planes, double tolerance,
                const shared_ptr<GridFluid>& fluid = fluidOf(true)) {
    const int rows = scene.particles.numRows;
    MatrixXd M;
    ConfinedRotnePragerYamakawaGrid(scene.particles, eta, tolerance, 0, planes, fluid)
        .at(scene.placement)
        ->multiply(MatrixXd::Identity(rows, rows), M);
    return M;
}

/** The norm of an error over the norm of the mobility, both scaled by roots of own mobilities. */
double relativeError(const MatrixXd& M, const MatrixXd& exact) {
    const VectorXd d = exact.diagonal().cwiseSqrt().cwiseInverse();
    const auto norm = [&](const MatrixXd& A) {
        return Eigen::SelfAdjointEigenSolver<MatrixXd>(
                   MatrixXd(0.5 * d.asDiagonal() * (A + A.transpose()) * d.asDiagonal()))
            .eigenvalues()
            .cwiseAbs()
            .maxCoeff();
    };
    return norm(M - exact) / norm(exact);
}

/** @param away  distance of walls from particles that would touch them otherwise */
void checkProducts(const vector<double>& tolerances, double away = 0) {
    for (Fluid fluid : {Wall, Channel, ClosedChannel})
        for (double height : {5.0, 2.05}) {
            const vector<double> radii =
                height < 3 ? vector<double>{1, 0.9} : vector<double>{1, 0.7, 0.85};
            Scene scene(height < 3 ? 5 : 12, height, 3 + fluid, radii);
            for (Vec3& x : scene.placement.positions) x[2] += away;
            const ConfiningPlanes planes = planesOf(fluid, height + 2 * away);
            const MatrixXd exact = exactOf(scene, planes);
            double largest = 0;
            for (double tolerance : tolerances) {
                const double error = relativeError(onGrid(scene, planes, tolerance), exact);
                EXPECT_LT(error, tolerance) << fluid << " " << height << " " << away;
                largest = max(largest, error / tolerance);
            }
            // Neither is the grid much finer than the tolerance asks for.
            EXPECT_GT(largest, away > 0 ? 0.01 : 0.03) << fluid << " " << height << " " << away;
        }
}

}  // namespace

TEST(ConfinedWaves, ProductsHaveTheTolerance) { checkProducts({1e-2, 1e-4}); }
TEST(ConfinedWaves, FullProductsHaveOtherTolerances) { checkProducts({1e-3, 1e-5, 1e-6, 1e-8}); }

TEST(ConfinedWaves, ProductsHaveTheToleranceAwayFromWalls) {
    for (double away : {0.3, 1.1}) checkProducts({1e-2, 1e-4}, away);
}
TEST(ConfinedWaves, FullProductsHaveOtherTolerancesAwayFromWalls) {
    for (double away : {0.26, 2.0, 6.0}) checkProducts({1e-3, 1e-5, 1e-6, 1e-8}, away);
}

TEST(ConfinedWaves, BothFluidsAndAnyNumberOfThreadsAgree) {
    for (Fluid fluid : {Wall, Channel}) {
        const Scene scene(allOrFew(7, 4), 5, 8);
        const ConfiningPlanes planes = planesOf(fluid);
        const double tolerance = fluid == Channel ? allOrFew(1e-3, 1e-2) : 1e-2;
        const MatrixXd plain = onGrid(scene, planes, tolerance, fluidOf(false)),
                       simd = onGrid(scene, planes, tolerance, fluidOf(true)),
                       threads = onGrid(scene, planes, tolerance, fluidOf(true, 2));
        EXPECT_LT(relativeError(simd, plain), 1e-11);
        EXPECT_EQ(simd, threads);
        // Averaging is the transpose of spreading.
        EXPECT_LT((simd - simd.transpose()).cwiseAbs().maxCoeff(),
                  1e-12 * simd.cwiseAbs().maxCoeff());
    }
}

TEST(ConfinedWaves, MatricesAreSumsAndNotProducts) {
    const double tolerance = 1e-3;
    for (Fluid fluid : {Wall, Channel}) {
        const Scene scene(7, 5, 8);
        const ConfiningPlanes planes = planesOf(fluid);
        const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0, planes,
                                                    fluidOf(true));
        MatrixXd M;
        model.at(scene.placement)->dense(M);
        EXPECT_EQ(M, exactOf(scene, planes));
        EXPECT_LT(relativeError(onGrid(scene, planes, tolerance), M), tolerance);
        // A small way from an accepted placement, particles stay where they are.
        Scene beyond = scene;
        for (Vec3& x : beyond.placement.positions) x[2] -= 1e-4;
        MatrixXd near, exact;
        model.near(beyond.placement)->dense(near);
        ConfinedRotnePragerYamakawa(scene.particles, eta, planes)
            .near(beyond.placement)
            ->dense(exact);
        EXPECT_EQ(near, exact);
        EXPECT_NE(near, M);
        EXPECT_LT(relativeError(near, M), 1e-3);
    }
}

TEST(ConfinedWaves, TheTopAboveAWallDoesNotMatter) {
    // A sphere high above the others makes the box of the grid higher.
    Scene scene(8, 4, 5);
    const ConfiningPlanes planes = planesOf(Wall);
    const MatrixXd exact = exactOf(scene, planes);
    scene.particles.add(1, false, 100, 100);
    for (double height : {8.0, 30.0}) {
        Scene more = scene;
        more.placement.positions.push_back(Vec3(1, 2, low + height));
        const MatrixXd M = onGrid(more, planes, 1e-4);
        EXPECT_LT(relativeError(M.topLeftCorner(exact.rows(), exact.rows()), exact), 1e-4);
    }
}

TEST(ConfinedWaves, TheBaseStaysFromStepToStep) {
    // Checks of the box ask for the lowest base in between.
    const Scene scene(4, 5, 6);
    const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, 1e-3, 0, planesOf(Wall),
                                                fluidOf(true));
    const BoxVectors& box = scene.placement.box;
    const auto low = model.baseFor(box, 2), high = model.baseFor(box, 4);
    EXPECT_NE(low.model, high.model);
    model.check(box);
    EXPECT_EQ(model.baseFor(box, 4).model, high.model);
    EXPECT_EQ(model.baseFor(box, 4.001).model, high.model);
    BoxVectors wider = box;
    wider[0][0] += 1;
    EXPECT_NE(model.baseFor(wider, 4).model, high.model);
}

TEST(ConfinedWaves, TheGridIsCoarserAwayFromWalls) {
    const Scene scene(4, 5, 6);  // the smallest radius is 0.7
    const BoxVectors& box = scene.placement.box;
    for (Fluid fluid : {Wall, Channel}) {
        const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, 1e-3, 0, planesOf(fluid),
                                                    fluidOf(true));
        const auto nodesOf = [&](double nearest) {
            const auto base = model.baseFor(box, 4, nearest);
            return base.model->splittingFor({box[0], box[1], Vec3(0, 0, base.period)})
                .shape.numNodes();
        };
        EXPECT_LT(nodesOf(1), nodesOf(0.7)) << fluid;
        EXPECT_LT(nodesOf(2), 0.4 * nodesOf(0.7)) << fluid;
        EXPECT_EQ(model.baseFor(box, 4, 0.7).model, model.baseFor(box, 4, 0.8).model);
        EXPECT_EQ(model.baseFor(box, 4, 0.6).longest, model.getLongestWave());
        EXPECT_NE(model.baseFor(box, 4, 0.9).model, model.baseFor(box, 4, 0.7).model);
        // Both walls count in a channel.
        Placement places = scene.placement;
        for (Vec3& x : places.positions) x[2] = low + 3;
        places.positions[2][2] = low + 4;
        ConfinedRotnePragerYamakawaGrid::Lifted lifted;
        model.lift(places, false, lifted);
        EXPECT_NEAR(lifted.nearest, fluid == Channel ? 1 : 3, 1e-12);
    }
}

TEST(ConfinedWaves, TheThirdVectorOfTheBoxDoesNotMatter) {
    Scene scene(4, 5, 6);
    const MatrixXd before = onGrid(scene, planesOf(Channel), 1e-3);
    scene.placement.box[2] = Vec3(0, 0, 44);
    EXPECT_EQ(onGrid(scene, planesOf(Channel), 1e-3), before);
}

TEST(ConfinedWaves, SmallStepsKeepTheGrid) {
    // Differences over a small step have the error of derivatives, not that of products.
    Scene scene(6, 5, 9);
    const ConfiningPlanes planes = planesOf(Channel);
    const double step = 1e-5, tolerance = 1e-4;
    const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0, planes,
                                                fluidOf(true));
    MatrixXd forces = MatrixXd::Ones(scene.particles.numRows, 1), v[2], exact[2];
    auto at = model.at(scene.placement);
    at->multiply(forces, v[0]);
    exact[0] = exactOf(scene, planes) * forces;
    Scene moved = scene;
    for (Vec3& x : moved.placement.positions) x += Vec3(1, -1, x[2] < low + 2.5 ? 1 : -1) * step;
    model.placeNear(at, moved.placement);
    at->multiply(forces, v[1]);
    exact[1] = exactOf(moved, planes) * forces;
    const VectorXd found = (v[1] - v[0]) / step, wanted = (exact[1] - exact[0]) / step;
    EXPECT_LT((found - wanted).norm(), 30 * tolerance * v[0].norm());
    EXPECT_GT(wanted.norm(), 0.01 * v[0].norm());
}

TEST(ConfinedWaves, DampsWhatReachesThroughAWall) {
    Scene scene(6, 5, 4);
    for (int i : {0, 1, 5})
        scene.placement.positions[i][2] += (i % 5 == 0 ? -0.4 : 0.5) * scene.particles.radii[i];
    const ConfiningPlanes planes = planesOf(Channel, 5, true);
    EXPECT_LT(relativeError(onGrid(scene, planes, 1e-4), exactOf(scene, planes)), 1e-4);
}

TEST(ConfinedWaves, ItsFlowIsThatOfTheMatrix) {
    const Scene scene(3, 5, 4);
    const ConfiningPlanes planes = planesOf(Channel);
    const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, 1);
    const vector<Vec3> points = {Vec3(1, 2, low + 0.3), Vec3(0, 0, low + 4)};
    Velocities flow[2] = {Velocities::Zero(3, 2), Velocities::Zero(3, 2)};
    const ConfinedRotnePragerYamakawaGrid grid(scene.particles, eta, 1e-3, 0, planes,
                                               fluidOf(true));
    const ConfinedRotnePragerYamakawa dense(scene.particles, eta, planes);
    grid.at(scene.placement)->addFlowAt({forces, {}}, points, 1, flow[0]);
    dense.at(scene.placement)->addFlowAt({forces, {}}, points, 1, flow[1]);
    EXPECT_EQ(flow[0], flow[1]);
    EXPECT_GT(flow[0].norm(), 1e-3);
}

TEST(ConfinedWaves, RefusesByName) {
    const Scene scene(2, 5, 4);
    const ConfinedRotnePragerYamakawaGrid coarse(scene.particles, eta, 1e-3, 0.8, planesOf(Wall),
                                                 fluidOf(true));
    expectError([&] { coarse.at(scene.placement); },
                {"RotnePragerYamakawa on a grid with walls needs a spacing of at most",
                 "setGridSpacing() gives 0.8 nm", "setSolverTolerance()"});
    BoxVectors skewed = scene.placement.box;
    skewed[1] = Vec3(1, 9, 0);
    const ConfinedRotnePragerYamakawaGrid grid(scene.particles, eta, 1e-3, 0, planesOf(Wall),
                                               fluidOf(true));
    expectError(
        [&] {
            grid.at({scene.placement.positions, skewed});
        },
        {"needs a box with edges along the axes", "setSolver(Dense)"});
}
