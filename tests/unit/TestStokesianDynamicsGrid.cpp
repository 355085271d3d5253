// Stokesian Dynamics of a periodic fluid by pairs and waves agrees with its matrices: products with
// the far field of forces, torques and stresslets, solves, noise and drift.

#include <Eigen/Dense>
#include <climits>
#include <cmath>
#include <random>

#include "GridFluidSupport.h"
#include "Instrumented.h"
#include "ShearedScenes.h"
#include "StepMoments.h"
#include "TestSupport.h"
#include "UnitNoise.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/NearAndFar.h"
#include "mobility/models/ewald/StokesianDynamicsGrid.h"
#include "mobility/models/ewald/WaveField.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/periodic/PeriodicStokesianDynamics.h"

using namespace Eigen;
using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace std;
using RigidHITest::covarianceOfFields;
using RigidHITest::expectError;
using RigidHITest::fluidElement;
using RigidHITest::JsonValue;
using RigidHITest::onThreads;
using RigidHITest::PosedBodies;
using RigidHITest::readTestData;
using RigidHITest::ShearedScene;
using RigidHITest::TestedBodies;
using RigidHITest::TestedStep;
using RigidHITest::UnitNoise;

namespace {

const double eta = 0.7;

/** Spheres at random places of a box, which do not overlap. */
struct Spheres {
    HydrodynamicParticles particles;
    Placement placement;

    /** @param tilt  of y along x, over the edge along x */
    Spheres(int number, const Vec3& edges, const vector<double>& radii, double gap, unsigned seed,
            double tilt = 0) {
        placement.box = {
            {Vec3(edges[0], 0, 0), Vec3(tilt * edges[0], edges[1], 0), Vec3(0, 0, edges[2])}};
        mt19937 random(seed);
        uniform_real_distribution<double> uniform(-1, 2);
        const Lattice lattice(placement.box);
        while (particles.size() < number) {
            const double a = radii[particles.size() % radii.size()];
            const Vec3 x(uniform(random) * edges[0], uniform(random) * edges[1],
                         uniform(random) * edges[2]);
            bool isFree = true;
            for (int j = 0; j < particles.size(); j++)
                isFree = isFree && lattice.nearestImage(x - placement.positions[j]).norm() >
                                       (1 + gap / 2) * (a + particles.radii[j]);
            if (!isFree) continue;
            particles.add(a, true, particles.size(), particles.size());
            placement.positions.push_back(x);
        }
    }
    int numRows() const { return 11 * particles.size(); }
};

/** Spheres at a volume fraction, in a cube. */
Spheres suspension(int number, double fraction, const vector<double>& radii, double gap,
                   unsigned seed) {
    double volume = 0;
    for (int i = 0; i < number; i++)
        volume += 4 * M_PI / 3 * pow(radii[i % radii.size()], 3) / fraction;
    const double edge = cbrt(volume);
    return Spheres(number, Vec3(edge, edge, edge), radii, gap, seed);
}

/** Spheres of a face-centred cubic lattice after random moves, for volume fractions up to 0.5. */
Spheres denseSuspension(int cells, double fraction) {
    Spheres spheres(0, Vec3(1, 1, 1), {1}, 0, 1);
    const int number = 4 * cells * cells * cells;
    const double edge = cbrt(number * 4 * M_PI / 3 / fraction);
    spheres.placement.box = {{Vec3(edge, 0, 0), Vec3(0, edge, 0), Vec3(0, 0, edge)}};
    vector<Vec3>& x = spheres.placement.positions;
    const Vec3 half[] = {Vec3(0, 0, 0), Vec3(0.5, 0.5, 0), Vec3(0.5, 0, 0.5), Vec3(0, 0.5, 0.5)};
    for (int i = 0; i < number; i++) {
        spheres.particles.add(1, true, i, i);
        const int cell = i / 4;
        x.push_back((Vec3(cell % cells, cell / cells % cells, cell / cells / cells) + half[i % 4]) *
                    (edge / cells));
    }
    mt19937 random(5);
    normal_distribution<double> normal(0, 0.1);
    const Lattice lattice(spheres.placement.box);
    const double closest = 2.001;
    for (int sweep = 0; sweep < 100; sweep++)
        for (int i = 0; i < number; i++) {
            const Vec3 moved = x[i] + Vec3(normal(random), normal(random), normal(random));
            bool isFree = true;
            for (int j = 0; j < number && isFree; j++)
                isFree = j == i || lattice.nearestImage(moved - x[j]).norm() > closest;
            if (isFree) x[i] = moved;
        }
    return spheres;
}

/** The matrix of forces, torques and stresslets by lattice sums. */
MatrixXd latticeSum(const Spheres& spheres) {
    LatticeSum sum(spheres.particles, overSurfaces(), true);
    sum.setBox(spheres.placement.box);
    MatrixXd M;
    sum.compute(spheres.placement.positions, false, M);
    return M / (8 * M_PI * eta);
}

double normOf(const MatrixXd& symmetric) {
    return SelfAdjointEigenSolver<MatrixXd>(symmetric, EigenvaluesOnly)
        .eigenvalues()
        .cwiseAbs()
        .maxCoeff();
}

vector<pair<const char*, Spheres>> scenes() {
    return {{"spheres at 0.2", suspension(20, 0.2, {1}, 0.01, 1)},
            {"unequal spheres at 0.2", suspension(24, 0.2, {1, 2}, 0.01, 2)},
            {"three radii in a flat box", Spheres(12, Vec3(14, 9, 6), {1, 0.6, 1.4}, 0.02, 3)},
            {"dilute", suspension(10, 0.005, {1, 0.5}, 0.01, 4)},
            {"one sphere", Spheres(1, Vec3(5, 6, 7), {1}, 0, 5)},
            {"one sphere in a small box", Spheres(1, Vec3(2.2, 2.2, 2.2), {1}, 0, 6)},
            {"a cube sheared by half", Spheres(20, Vec3(8, 8, 8), {1, 1.4}, 0.01, 7, 0.5)},
            {"a skew box", Spheres(12, Vec3(9, 12, 6), {1}, 0.01, 8, -0.4)}};
}

/** @param most  leaves out scenes with more spheres */
void checkStresslets(const vector<double>& tolerances, int most = INT_MAX) {
    vector<pair<const char*, Spheres>> all = scenes();
    all.push_back({"dense spheres", denseSuspension(2, 0.5)});
    // Errors of a lattice add up, and so do those of large spheres among small ones.
    all.push_back({"a crystal", denseSuspension(3, 0.7)});
    all.push_back(
        {"large spheres among small ones", suspension(40, 0.2, {2.5, 0.5, 0.5}, 0.01, 7)});
    for (const auto& [what, spheres] : all) {
        if (spheres.particles.size() > most) continue;
        const MatrixXd exact = latticeSum(spheres);
        for (double tolerance : tolerances) {
            const RotnePragerYamakawaGrid model(spheres.particles, eta, tolerance, 0,
                                                make_shared<CpuGridFluid>(), {}, true);
            const VectorXd root = sqrt(6 * M_PI * eta) * model.rootsOfOwn();
            const double norm = normOf(root.asDiagonal() * exact * root.asDiagonal());
            MatrixXd M;
            model.at(spheres.placement)
                ->multiply(MatrixXd::Identity(spheres.numRows(), spheres.numRows()), M);
            EXPECT_LE((M - M.transpose()).norm(), 1e-13 * M.norm()) << what;
            const MatrixXd difference =
                root.asDiagonal() * (0.5 * (M + M.transpose()) - exact).eval() * root.asDiagonal();
            const double error = normOf(difference) / norm;
            EXPECT_LE(error, tolerance)
                << what << ", " << model.grid()->describe(spheres.placement.box);
            printf("%s, %g: error %.2f of the tolerance\n", what, tolerance, error / tolerance);
        }
    }
}

}  // namespace

TEST(StokesianDynamicsGrid, ProductsOfStressletsHaveTheTolerance) {
    checkStresslets({1e-3});
    checkStresslets({1e-8}, 12);  // in boxes of each kind, and where errors of many add up in Full…
}
TEST(StokesianDynamicsGrid, FullProductsOfStressletsHaveEveryTolerance) {
    checkStresslets({1e-2, 1e-4, 1e-6, 1e-8});
}

TEST(StokesianDynamicsGrid, ProductsAreThoseOfThePlainGridAndOfAnyNumberOfThreads) {
    for (const auto& [what, spheres] : scenes()) {
        const VectorXd forces = VectorXd::LinSpaced(spheres.numRows(), 1, 3);
        const auto product = [&](const shared_ptr<GridFluid>& fluid) {
            const RotnePragerYamakawaGrid model(spheres.particles, eta, 1e-4, 0, fluid, {}, true);
            MatrixXd velocities;
            model.at(spheres.placement)->multiply(forces, velocities);
            return velocities;
        };
        const MatrixXd first = product(make_shared<CpuGridFluid>());
        EXPECT_LE((product(make_shared<PlainGridFluid>()) - first).norm(), 1e-12 * first.norm())
            << what;
        for (int threads : {2, 3})
            EXPECT_EQ(product(make_shared<CpuGridFluid>(onThreads(threads))), first)
                << what << " " << threads;
    }
}

namespace {

const LubricationReach reach = {3, 4};

unique_ptr<StokesianDynamicsGrid> gridOf(const Spheres& spheres, double tolerance,
                                         bool lubrication = true,
                                         const LubricationReach& to = reach) {
    return make_unique<StokesianDynamicsGrid>(spheres.particles, eta, lubrication, tolerance, 0, to,
                                              make_shared<CpuGridFluid>());
}
unique_ptr<PeriodicStokesianDynamics> matrixOf(const Spheres& spheres, bool lubrication = true,
                                               const LubricationReach& to = reach) {
    return make_unique<PeriodicStokesianDynamics>(spheres.particles, eta, lubrication, 0, to);
}
MatrixXd randomVectors(int rows, int columns, unsigned seed) {
    mt19937 random(seed);
    normal_distribution<double> normal;
    return MatrixXd::NullaryExpr(rows, columns, [&]() { return normal(random); });
}
/** Random wrenches, as large as own frictions. */
MatrixXd randomWrenches(const Spheres& spheres, int columns, unsigned seed) {
    return rootsOfOwnFriction(spheres.particles).asDiagonal() *
           randomVectors(spheres.particles.numRows, columns, seed);
}
/** The error of a velocity over the velocity, both in the norm of the friction. */
double errorInEnergy(const MatrixXd& friction, const MatrixXd& found, const MatrixXd& right) {
    const MatrixXd e = found - right;
    return sqrt((e.transpose() * friction * e)(0, 0) /
                (right.transpose() * friction * right)(0, 0));
}

void checkVelocities(const vector<double>& tolerances) {
    vector<pair<const char*, Spheres>> all = scenes();
    all.push_back({"dense, small gaps", denseSuspension(2, 0.45)});
    all.push_back({"unequal, small gaps", suspension(30, 0.25, {1, 2}, 1e-3, 12)});
    for (const auto& [what, spheres] : all)
        for (bool lubrication : {true, false}) {
            MatrixXd friction, right, found;
            const auto matrix = matrixOf(spheres, lubrication);
            const auto place = matrix->at(spheres.placement);
            place->friction(friction);
            const MatrixXd F = randomWrenches(spheres, 1, 3);
            place->multiply(F, right);
            for (double tolerance : lubrication ? tolerances : vector<double>{1e-3, 1e-8}) {
                const auto model = gridOf(spheres, tolerance, lubrication);
                const auto at = model->at(spheres.placement);
                at->multiply(F, found, {tolerance});
                const double error = errorInEnergy(friction, found, right);
                EXPECT_LE(error, tolerance) << what << " " << lubrication;
                printf("%s, lubrication %d, %g: error %.2f of the tolerance, %lld iterations\n",
                       what, lubrication, tolerance, error / tolerance,
                       at->parts()->getNumIterations());
            }
        }
}

}  // namespace

TEST(StokesianDynamicsGrid, VelocitiesAreThoseOfMatricesToTheTolerance) {
    checkVelocities({1e-2, 1e-4, 1e-8});
}
TEST(StokesianDynamicsGrid, FullVelocitiesHaveTolerancesInBetween) {
    checkVelocities({1e-3, 1e-6});
}

TEST(StokesianDynamicsGrid, TwoSpheresAreExact) {
    // In matrices and here alike, the lubrication of a pair within reach is whole.
    for (double gap : {1e-4, 1e-2, 0.5}) {
        Spheres spheres(1, Vec3(12, 11, 10), {1}, 0, 1);
        spheres.particles.add(1.7, true, 1, 1);
        spheres.placement.positions.push_back(spheres.placement.positions[0] +
                                              Vec3(0.48, 0.6, 0.64) * (2.7 + 1.35 * gap));
        MatrixXd right, found;
        const MatrixXd F = randomWrenches(spheres, 3, 5);
        matrixOf(spheres)->at(spheres.placement)->multiply(F, right);
        gridOf(spheres, 1e-11)->at(spheres.placement)->multiply(F, found);
        EXPECT_LE((found - right).norm(), 1e-9 * right.norm()) << gap;
    }
}

/** A sphere has lubrication with its own images, in shear and when it turns. */
TEST(StokesianDynamicsGrid, SpheresAlmostTouchTheirOwnImages) {
    DrivenFlow shear;
    shear.gradient << 0.1, 1, 0, 0.3, -0.3, 0, 0, 0.2, 0.2;
    for (const Vec3& edges : {Vec3(2.02, 2.02, 2.02), Vec3(2.001, 5, 6), Vec3(7, 2.1, 6)}) {
        Spheres sphere(1, edges, {1}, 0, 1);
        const auto matrix = matrixOf(sphere);
        const auto grid = gridOf(sphere, 1e-8);
        const auto right = matrix->at(sphere.placement), found = grid->at(sphere.placement);
        MatrixXd u, v;
        const MatrixXd F = randomWrenches(sphere, 3, 5);
        right->multiply(F, u);
        found->multiply(F, v);
        EXPECT_LE((u - v).norm(), 1e-7 * u.norm()) << edges;
        const FlowSources a = right->sources(F.leftCols(1), &shear),
                          b = found->sources(F.leftCols(1), &shear);
        EXPECT_LE((a.stresslets - b.stresslets).norm(), 1e-7 * a.stresslets.norm()) << edges;
    }
}

TEST(StokesianDynamicsGrid, ReferenceScenesHaveTheirTwistsStressletsAndStress) {
    const JsonValue scenes = readTestData("sheared/periodic_sheared");
    for (int k = 0; k < 3; k++) {  // a cube, and two tilts of it
        SCOPED_TRACE(k);
        const ShearedScene scene(scenes[k]);
        const StokesianDynamicsGrid model(scene.particles, scene.viscosity, true, 1e-9, 0,
                                          PeriodicStokesianDynamics::reachByDefault,
                                          make_shared<CpuGridFluid>());
        const auto at = model.at(scene.placement);
        scene.check(*at, 1e-8);
        const VectorXd wrench = scene.data["wrench"].column();
        MatrixXd product;
        at->multiply(scene.data["frictionTimesWrenchNumbers"].column(), product);
        EXPECT_LT((product - wrench).norm(), 1e-8 * wrench.norm());
    }
}

TEST(StokesianDynamicsGrid, FlowsAndStressletsAreThoseOfMatrices) {
    const Spheres spheres = suspension(20, 0.25, {1, 1.5}, 0.01, 21);
    const double edge = spheres.placement.box[0][0];
    DrivenFlow wave, shear, both;
    wave.waveVelocity = 1;
    wave.k = 2 * M_PI / edge;
    shear.gradient << 0.1, 1, 0, 0.3, -0.3, 0, 0, 0.2, 0.2;
    const MatrixXd F = randomWrenches(spheres, 1, 9);
    for (bool lubrication : {true, false}) {
        const auto matrix = matrixOf(spheres, lubrication);
        const auto grid = gridOf(spheres, 1e-8, lubrication);
        const auto right = matrix->at(spheres.placement), found = grid->at(spheres.placement);
        for (const DrivenFlow* flow :
             {(const DrivenFlow*)nullptr, (const DrivenFlow*)&wave, (const DrivenFlow*)&shear}) {
            const FlowSources a = right->sources(F, flow), b = found->sources(F, flow);
            EXPECT_LE((a.stresslets - b.stresslets).norm(), 1e-7 * a.stresslets.norm());
            EXPECT_EQ(a.forces, b.forces);
            if (!flow) continue;
            MatrixXd u = MatrixXd::Zero(F.rows(), 1), v = u;
            right->addStressletsOf(*flow, u);
            found->addStressletsOf(*flow, v);
            EXPECT_LE((u - v).norm(), 1e-7 * u.norm());
            const vector<Vec3> points = {Vec3(0.1, 0.2, 0.3), Vec3(3, 1, 2)};
            Velocities p = Velocities::Zero(3, 2), q = p;
            right->addFlowAt(a, points, 1, p);
            found->addFlowAt(b, points, 1, q);
            EXPECT_LE((p - q).norm(), 1e-6 * p.norm());
        }
    }
}

TEST(StokesianDynamicsGrid, SolvesTakeForcesAndSlipsOfStresslets) {
    // U = N (F + B^T M^-1 s), by matrices.
    const Spheres spheres = suspension(12, 0.25, {1, 1.4}, 0.01, 31);
    const int n = spheres.particles.numRows, rows = spheres.numRows();
    const MatrixXd inverse = latticeSum(spheres).inverse();
    MatrixXd friction;
    matrixOf(spheres)->at(spheres.placement)->friction(friction);
    const MatrixXd F = randomWrenches(spheres, 2, 7), s = randomVectors(rows, 2, 8);
    const MatrixXd right = friction.ldlt().solve(F + (inverse * s).topRows(n));
    const auto model = gridOf(spheres, 1e-9);
    const auto at = model->at(spheres.placement);
    MatrixXd found, ofFar, check;
    at->parts()->solve(1e-9, F, s, found, ofFar);
    EXPECT_LE((found - right).norm(), 1e-8 * right.norm());
    at->parts()->far().multiply(ofFar, check);
    check += s;
    check.topRows(n) -= found;
    EXPECT_LE(check.norm(), 1e-8 * s.norm());
    // Slips alone, and (1 + M Delta)^-1.
    at->parts()->solve(1e-9, MatrixXd::Zero(n, 2), s, found, ofFar);
    EXPECT_LE((found - friction.ldlt().solve((inverse * s).topRows(n))).norm(),
              1e-8 * found.norm());
    MatrixXd velocities = s.topRows(n), farFriction;
    matrixOf(spheres, false)->at(spheres.placement)->friction(farFriction);
    at->parts()->solve(1e-9, velocities);
    EXPECT_LE((friction * velocities - farFriction * s.topRows(n)).norm(),
              1e-7 * (farFriction * s.topRows(n)).norm());
}

namespace {

/** Move every sphere to this gap from its nearest neighbour, where there is room. */
void moveCloser(Spheres& spheres, double gap) {
    vector<Vec3>& x = spheres.placement.positions;
    const double edge = spheres.placement.box[0][0];  // of a cube
    const auto nearest = [&](size_t i, Vec3& towards) {
        double least = edge;
        for (size_t j = 0; j < x.size(); j++) {
            Vec3 apart = x[j] - x[i];
            for (int k = 0; k < 3; k++) apart[k] -= edge * round(apart[k] / edge);
            const double distance = sqrt(apart.dot(apart));
            if (j == i || distance >= least) continue;
            least = distance;
            towards = apart / distance;
        }
        return least;
    };
    for (size_t i = 0; i < x.size(); i++) {
        const Vec3 before = x[i];
        Vec3 towards, unused;
        const double distance = nearest(i, towards);
        x[i] += towards * (distance - 2 - gap * (1 + 1e-9));
        if (nearest(i, unused) < 2 + gap) x[i] = before;
    }
}

}  // namespace

TEST(StokesianDynamicsGrid, IterationsAreFew) {
    // At most twice those of the prototype, in which the true error was looked at.
    const struct {
        int cells;
        double fraction, gap;  // 0: as it comes
        int to1e3, to1e6;
    } table[] = {
        {3, 0.3, 0, 12, 23}, {3, 0.45, 0, 19, 37}, {4, 0.3, 1e-4, 15, 26}, {4, 0.45, 1e-4, 22, 39}};
    for (const auto& row : table) {
        if (RigidHITest::isInstrumented() && row.cells > 3) continue;
        Spheres spheres = denseSuspension(row.cells, row.fraction);
        if (row.gap > 0) moveCloser(spheres, row.gap);
        const MatrixXd F = randomWrenches(spheres, 1, 2);
        MatrixXd U;
        for (const double tolerance : {1e-3, 1e-6}) {
            const auto model = gridOf(spheres, tolerance);
            const auto at = model->at(spheres.placement);
            at->multiply(F, U, {tolerance});
            const int iterations = at->parts()->getNumIterations();
            printf("volume fraction %g, tolerance %g: %d iterations\n", row.fraction, tolerance,
                   iterations);
            EXPECT_LE(iterations, 2 * (tolerance > 1e-4 ? row.to1e3 : row.to1e6)) << row.fraction;
        }
    }
}

namespace {

/** @param tilt  of the box, over its edge along x */
void checkFieldsOfWaves(double tilt) {
    const Spheres spheres(2, Vec3(4.1, 3.6, 5.4), {1, 0.8}, 0.01, 5, tilt);
    const vector<EwaldKind> kinds = kindsOf(spheres.particles, true);
    const SplitBox inBox(kinds, EwaldSplitting(kinds, 1e-1, 0, spheres.placement.box),
                         spheres.placement.box);
    for (const shared_ptr<GridFluid>& fluid :
         {shared_ptr<GridFluid>(make_shared<CpuGridFluid>()),
          shared_ptr<GridFluid>(make_shared<PlainGridFluid>())}) {
        WaveField waves(spheres.particles, kinds);
        waves.setBox(inBox);
        waves.moveTo(spheres.placement.positions, false);
        const int rows = spheres.numRows();
        MatrixXd M = MatrixXd::Zero(rows, rows);
        for (int i = 0; i < rows; i++) {
            const VectorXd force = VectorXd::Unit(rows, i);
            waves.addProduct(*fluid, eta, false, force.data(), M.col(i).data());
        }
        vector<GridField> fields;
        const array<int, 3>& size = inBox.splitting.shape.size;
        const MatrixXd covariance = covarianceOfFields(
            size, rows, -size[1] / 2, CounterModeNoise::isMirrored, [&](const UnitNoise& noise) {
                waves.draw(*fluid, eta, noise, fields);
                VectorXd column = VectorXd::Zero(rows);
                waves.addAverages(*fluid, fields, column.data());
                return column;
            });
        EXPECT_LE((covariance - M).norm(), 1e-12 * M.norm());
    }
}

}  // namespace

TEST(StokesianDynamicsGrid, FieldsOfWavesHaveTheCovarianceOfProducts) { checkFieldsOfWaves(0); }
TEST(StokesianDynamicsGrid, FieldsInASkewBoxHaveTheCovarianceOfProducts) {
    checkFieldsOfWaves(-0.4);
}

TEST(StokesianDynamicsGrid, RandomFieldsHaveTheCovarianceOfTheFarField) {
    const Spheres spheres(3, Vec3(5, 6, 5.5), {1, 0.8}, 0.01, 6);
    const auto model = gridOf(spheres, 1e-3);
    const MatrixXd M = latticeSum(spheres);
    const MatrixXd root = SelfAdjointEigenSolver<MatrixXd>(M).operatorInverseSqrt();
    MatrixXd sum = MatrixXd::Zero(M.rows(), M.rows()), slips;
    const int samples = 3000;
    unique_ptr<RandomField> field;
    for (int k = 0; k < samples; k++) {
        NoiseStream noise;
        noise.step = k;
        model->randomField()->draw(noise, NoiseStream::ParticleFirstDraw, spheres.placement.box,
                                   field);
        field->slipsAt(spheres.placement, false, slips);
        const VectorXd white = root * slips;
        sum += white * white.transpose() / samples;
    }
    EXPECT_LT((sum - MatrixXd::Identity(M.rows(), M.rows())).cwiseAbs().maxCoeff(),
              5.5 * sqrt(2.0 / samples));
}

namespace {

PosedBodies sceneOf(const Spheres& spheres, const CoupledBodies::ModelFactory& makeModel) {
    PosedBodies scene;
    scene.box = spheres.placement.box;
    scene.makeModel = makeModel;
    for (int i = 0; i < spheres.particles.size(); i++) {
        const Vec3& x = spheres.placement.positions[i];
        scene.add(fluidElement(i, {{0, 0, 0}}, {spheres.particles.radii[i]}), {x[0], x[1], x[2]});
    }
    scene.wrenches.setZero(scene.numRows(), 1);
    return scene;
}
const CoupledBodies::ModelFactory byMatrices =
                                      [](const HydrodynamicParticles&p) {
                                          return make_unique<PeriodicStokesianDynamics>(
                                              p, eta, true, 0, reach);
                                      },
                                  onGrid = [](const HydrodynamicParticles&p) {
                                      return make_unique<StokesianDynamicsGrid>(
                                          p, eta, true, 1e-7, 0, reach,
                                          make_shared<CpuGridFluid>());
                                  };

/** Two spheres with a gap of so many mean radii. */
Spheres nearPair(double gap) {
    Spheres spheres(0, Vec3(7, 6.5, 6), {1}, 0, 1);
    spheres.particles.add(1, true, 0, 0);
    spheres.particles.add(0.8, true, 1, 1);
    spheres.placement.positions = {Vec3(0.1, 0.2, 0.3),
                                   Vec3(0.1, 0.2, 0.3) + Vec3(0.48, 0.6, 0.64) * (1.8 + 0.9 * gap)};
    return spheres;
}

/** The mean of a step without forces at kT = 1 and without the noise, which is the same in all. */
VectorXd driftOf(CustomRigidHIIntegrator::Scheme scheme, const Spheres& spheres,
                 const CoupledBodies::ModelFactory& makeModel, bool byMatrices) {
    PosedBodies scene = sceneOf(spheres, makeModel);
    TestedBodies bodies = scene.bodies(1e-7);
    bodies->setBox(scene.box);
    TestedStep step(scheme, scene, byMatrices ? bodies.byMatrices() : bodies.byProducts(), 1, 1);
    return (step.mean() - step.take({})).head(scene.numRows());
}

}  // namespace

TEST(StokesianDynamicsGrid, StepsHaveTheDriftOfMatrices) {
    Spheres spheres = nearPair(0.05);
    spheres.particles.add(0.9, true, 2, 2);
    spheres.placement.positions.push_back(Vec3(-1.5, 0.9, 1.1));
    const VectorXd right =
        driftOf(CustomRigidHIIntegrator::TractionEulerMaruyama, spheres, byMatrices, true);
    ASSERT_GT(right.norm(), 1e-4);
    for (const auto scheme : {CustomRigidHIIntegrator::TractionEulerMaruyama,
                              CustomRigidHIIntegrator::RandomFiniteDifference}) {
        const VectorXd drift = driftOf(scheme, spheres, onGrid, false);
        EXPECT_LE((drift - right).norm(), 1e-3 * right.norm()) << scheme;
    }
}

TEST(StokesianDynamicsGrid, FullTrapezoidalSlipHasTheDriftOfMatrices) {
    // Its drift comes from the slips of the start at the end of a predictor, so that it is a mean
    // over the noise. EulerMaruyama has the same noise without drift, and is subtracted.
    const Spheres spheres = nearPair(0.1);
    const VectorXd right =
        driftOf(CustomRigidHIIntegrator::TractionEulerMaruyama, spheres, byMatrices, true);
    const double h = 1e-4;
    const int samples = 2500, rows = right.size();
    PosedBodies scene = sceneOf(spheres, [](const HydrodynamicParticles& p) {
        return make_unique<StokesianDynamicsGrid>(p, eta, true, 1e-4, 0, reach,
                                                  make_shared<CpuGridFluid>());
    });
    TestedBodies bodies = scene.bodies(1e-4);
    bodies->setBox(scene.box);
    TestedStep step(CustomRigidHIIntegrator::TrapezoidalSlip, scene, bodies.byProducts(), h, 1),
        without(CustomRigidHIIntegrator::EulerMaruyama, scene, bodies.byProducts(), h, 1);
    // What depends on directions is quadratic in them, and hardly depends on the noise.
    const VectorXd middle = step.take({});
    VectorXd ofDirections = VectorXd::Zero(rows);
    for (uint32_t i = 0; i < 2; i++)
        for (int c = 0; c < 6; c++)
            ofDirections +=
                (step.take({{{NoiseStream::FiniteDifference, i, c}, 1}}) - middle).head(rows);
    VectorXd sum = VectorXd::Zero(rows), squares = sum;
    for (int k = 0; k < samples; k++) {
        step.step.noise.step = without.step.noise.step = k;
        const VectorXd drift = (step.take({}) - without.take({})).head(rows);
        sum += drift / samples;
        squares += drift.cwiseAbs2() / samples;
    }
    const VectorXd error = ((squares - sum.cwiseAbs2()) / samples).cwiseSqrt();
    for (int row = 0; row < rows; row++) {
        if (row % 6 > 2) continue;  // spheres' rotations are no coordinates of N
        printf("drift along %d: %g, of matrices %g, error of the mean %g, of directions %g\n", row,
               sum[row] + ofDirections[row], right[row], error[row], ofDirections[row]);
        EXPECT_NEAR(sum[row] + ofDirections[row], right[row], 5 * error[row] + 0.02 * right.norm())
            << row;
        EXPECT_LT(error[row], 0.1 * right.norm());
    }
}

TEST(StokesianDynamicsGrid, FlowsAreSlipsOfASolve) {
    Spheres spheres = nearPair(0.05);
    PosedBodies matrices = sceneOf(spheres, byMatrices), grid = sceneOf(spheres, onGrid);
    DrivenFlow wave, shear;
    wave.waveVelocity = 1;
    wave.k = 2 * M_PI / spheres.placement.box[1][1];
    shear.velocity = Vector3d(0.1, 0.2, 0.3);
    shear.gradient << 0.1, 1, 0, 0.3, -0.3, 0, 0, 0.2, 0.2;
    for (const DrivenFlow& flow : {wave, shear}) {
        MatrixXd right, slips, found;
        TestedBodies ofMatrices = matrices.bodies(1e-7), ofGrid = grid.bodies(1e-7);
        ofMatrices->setBox(matrices.box);
        ofGrid->setBox(grid.box);
        BodyMobility &a = ofMatrices.byMatrices(), &b = ofGrid.byProducts();
        a.setPoses(matrices.poses);
        a.flow().twistsOf(flow, right);
        b.setPoses(grid.poses);
        b.flow().twistsOf(flow, found);
        EXPECT_LE((found - right).norm(), 1e-6 * right.norm());
        b.flowSlipsOfSolve(flow, slips);
        // A uniform strain has wrenches and slips of the far field; a wave has a solve of its own.
        EXPECT_EQ(slips.rows(), flow.waveVelocity == 0 ? 12 + 12 + 22 : 12);
        b.solve(MatrixXd::Zero(12, 1), slips, found);
        EXPECT_LE((found - right).norm(), 1e-6 * right.norm());
    }
}

TEST(StokesianDynamicsGrid, ThreadsDoNotChangeABitOfASolve) {
    const Spheres spheres = suspension(30, 0.3, {1, 1.3}, 1e-2, 41);
    MatrixXd first;
    const MatrixXd F = randomWrenches(spheres, 1, 1);
    for (int threads : {1, 3}) {
        const StokesianDynamicsGrid model(spheres.particles, eta, true, 1e-4, 0, reach,
                                          make_shared<CpuGridFluid>(onThreads(threads)));
        MatrixXd U;
        model.at(spheres.placement)->multiply(F, U, {1e-4});
        if (threads == 1) first = U;
        EXPECT_EQ(U, first);
    }
}

TEST(StokesianDynamicsGrid, RefusesWhatHasNoMobility) {
    Spheres spheres(1, Vec3(12, 11, 10), {1}, 0, 1);
    spheres.placement.positions[0] = Vec3(0.5, 5, 5);
    spheres.particles.add(1.5, true, 7, 1);
    spheres.placement.positions.push_back(Vec3(10.3, 5, 5));
    expectError([&] { gridOf(spheres, 1e-3)->at(spheres.placement); },
                {"StokesianDynamics", "an image of particle 7", "overlap or touch", "2.2", "2.5",
                 "setMinimumGap()"});
    // Lubrication or not, the far field has no other form.
    expectError([&] { gridOf(spheres, 1e-3, false)->at(spheres.placement); },
                {"an image of particle 7", "overlap or touch"});
    Spheres small(1, Vec3(1.9, 5, 5), {1}, 0, 1);
    expectError([&] { gridOf(small, 1e-3)->at(small.placement); },
                {"the nearest image of particle 0", "overlap or touch", "1.9"});
    Spheres many(0, Vec3(90, 90, 90), {1}, 0, 1);
    for (int i = 0; i < 9; i++) {
        many.particles.add(1 + 0.1 * i, true, i, i);
        many.placement.positions.push_back(Vec3(9 * i, 0, 0));
    }
    expectError(
        [&] { gridOf(many, 1e-3, false); },
        {"StokesianDynamics on a grid has 9 different radii", "at most 8", "setSolver(Dense)"});
}
