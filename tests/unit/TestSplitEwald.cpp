// The periodic Rotne-Prager-Yamakawa mobility by pairs and waves agrees with lattice sums. Both
// parts are positive, and the field of the waves has their covariance.

#include <Eigen/Dense>
#include <climits>
#include <cmath>
#include <random>

#include "GridFluidSupport.h"
#include "Instrumented.h"
#include "TestSupport.h"
#include "UnitNoise.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/ewald/NearField.h"
#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"
#include "mobility/models/ewald/WaveField.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/periodic/PeriodicMobility.h"

using namespace Eigen;
using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace std;
using RigidHITest::covarianceOfFields;
using RigidHITest::isInstrumented;
using RigidHITest::onThreads;
using RigidHITest::UnitNoise;

namespace {

const double eta = 0.7;

BoxVectors orthogonal(double x, double y, double z) {
    return {{Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z)}};
}

BoxVectors leaning(double x, double y, double z, double xOfY, double xOfZ, double yOfZ) {
    return {{Vec3(x, 0, 0), Vec3(xOfY, y, 0), Vec3(xOfZ, yOfZ, z)}};
}

/** Particles at random places, inside and outside of the box, which may overlap. */
struct Scene {
    const char* what;
    HydrodynamicParticles particles;
    Placement placement;

    enum Kind { Blobs, Spheres, Mixed };
    Scene(const char* what, int number, const BoxVectors& box, Kind kind,
          const vector<double>& radii, unsigned seed)
        : what(what) {
        mt19937 random(seed);
        uniform_real_distribution<double> uniform(-1, 2);
        placement.box = box;
        for (int i = 0; i < number; i++) {
            particles.add(radii[i % radii.size()], kind == Spheres || (kind == Mixed && i % 3 > 0),
                          i, i);
            placement.positions.push_back(Vec3(uniform(random) * box[0][0],
                                               uniform(random) * box[1][1],
                                               uniform(random) * box[2][2]));
        }
    }
};

vector<Scene> scenes() {
    return {
        {"blobs in a cube, 0.2", 100, orthogonal(12.8, 12.8, 12.8), Scene::Blobs, {1}, 1},
        {"blobs, dilute", 40, orthogonal(40, 35, 52), Scene::Blobs, {1}, 2},
        {"spheres", 50, orthogonal(9, 10.5, 12), Scene::Spheres, {1}, 3},
        {"unequal blobs", 60, orthogonal(14, 10, 11), Scene::Blobs, {1, 0.6, 1.7}, 4},
        {"unequal spheres and blobs", 36, orthogonal(9, 12, 10), Scene::Mixed, {1, 1.4}, 5},
        {"crowded blobs", 120, orthogonal(5, 5.5, 6), Scene::Blobs, {1}, 6},
        {"a box that pairs reach across", 3, orthogonal(2.6, 3, 2.4), Scene::Mixed, {1, 0.5}, 7},
        {"one sphere", 1, orthogonal(5, 6, 7), Scene::Spheres, {1}, 8},
        {"a blob that nearly touches its images",
         1,
         orthogonal(2.05, 2.05, 2.05),
         Scene::Blobs,
         {1},
         9},
        {"two blobs there", 2, orthogonal(2.05, 2.05, 2.05), Scene::Blobs, {1}, 10},
        {"a blob in a small cube", 1, orthogonal(3, 3, 3), Scene::Blobs, {1}, 11},
        {"a blob in a cube", 1, orthogonal(4, 4, 4), Scene::Blobs, {1}, 12},
        {"a blob in a small flat box", 1, orthogonal(3, 9, 9), Scene::Blobs, {1}, 13},
        {"unequal spheres in a narrow box",
         3,
         orthogonal(4.2, 4.2, 42),
         Scene::Spheres,
         {1.7, 0.17, 0.6},
         14},
        {"a cube sheared by half", 50, leaning(9, 9, 9, 4.5, 0, 0), Scene::Mixed, {1, 1.4}, 15},
        {"a flat box sheared along its long edge",
         30,
         leaning(16, 8, 7, 0, 0, -3.1),
         Scene::Spheres,
         {1},
         16},
        {"a rhombic dodecahedron",
         60,
         leaning(12, 12, 6 * sqrt(2.0), 0, 6, 6),
         Scene::Blobs,
         {1, 0.7},
         17},
        {"a small triclinic box that pairs reach across",
         3,
         leaning(2.8, 2.6, 2.7, -0.9, 1.2, 0.7),
         Scene::Mixed,
         {1, 0.5},
         18}};
}

VectorXd roots(const HydrodynamicParticles& particles) {
    VectorXd root(particles.numRows);
    for (int p = 0; p < particles.size(); p++) {
        const double a = particles.radii[p];
        root.segment<3>(particles.firstRow[p]).setConstant(sqrt(6 * M_PI * eta * a));
        if (particles.hasTorque[p])
            root.segment<3>(particles.firstRow[p] + 3)
                .setConstant(sqrt(8 * M_PI * eta * a * a * a));
    }
    return root;
}
/** Entries over the roots of the particles' own mobilities. */
MatrixXd scaled(const MatrixXd& difference, const HydrodynamicParticles& particles) {
    const VectorXd root = roots(particles);
    return root.asDiagonal() * difference * root.asDiagonal();
}
double normOf(const MatrixXd& symmetric) {
    return SelfAdjointEigenSolver<MatrixXd>(symmetric, EigenvaluesOnly)
        .eigenvalues()
        .cwiseAbs()
        .maxCoeff();
}

MatrixXd latticeSum(const Scene& scene) {
    MatrixXd M;
    PeriodicRotnePragerYamakawa(scene.particles, eta).at(scene.placement)->dense(M);
    return M;
}

shared_ptr<GridFluid> plainFluid() { return make_shared<PlainGridFluid>(); }
}  // namespace

TEST(SplitEwald, TablesAreThePairsToRounding) {
    const vector<EwaldKind> kinds = {{0.4, 1, 1}, {1, 1, 1}};
    for (double xi : {0.1, 0.5, 2.0}) {
        const double gap = 5 / xi;
        const NearTables tables(kinds, 6, xi, gap, 0.1), ofForces(kinds, 2, xi, gap, 0.1);
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 2; j++) {
                const double a = kinds[i].radius, b = kinds[j].radius;
                const NearPair pair(a, b, xi, true);
                for (double r = 0; r < gap + a + b + 0.1; r += 0.0371 / xi) {
                    double f[6];
                    tables.at<6>(i, j, r, f);
                    double g2[2];
                    ofForces.at<2>(i, j, r, g2);
                    const PairFunctions g = pair.at(r);
                    const double expected[] = {g.ttI, g.ttR, g.tr, g.rt, g.rrI, g.rrR};
                    const PairFunctions h = overSurfaces().free(a, b, a + b, true, false);
                    const double scale[] = {h.ttI, h.ttR, h.tr, h.rt, h.rrI, h.rrR};
                    EXPECT_EQ(g2[0], f[0]);
                    EXPECT_EQ(g2[1], f[1]);
                    for (int c = 0; c < 6; c++)
                        EXPECT_NEAR(f[c], expected[c], 1e-10 * abs(scale[c]))
                            << xi << " " << a << " " << b << " " << r << " " << c;
                }
            }
    }
}

namespace {

/** Arrangements in which errors add up: a crystal, a cluster in a large box, shells of overlapping
 * blobs, large particles among small ones. */
vector<Scene> arrangements() {
    vector<Scene> all = {
        {"a face-centred cubic array, 0.5",
         108,
         orthogonal(9.67, 9.67, 9.67),
         Scene::Blobs,
         {1},
         1},
        {"an array of spheres", 27, orthogonal(6.1, 6.1, 6.1), Scene::Spheres, {1}, 1},
        {"a cluster of blobs", 100, orthogonal(25, 25, 25), Scene::Blobs, {1}, 1},
        {"shells of blobs", 126, orthogonal(14, 14, 14), Scene::Blobs, {1}, 1},
        {"large blobs among small ones",
         100,
         orthogonal(16, 16, 16),
         Scene::Blobs,
         {3, 0.7, 0.7, 0.7, 0.7},
         1}};
    vector<Vec3>*const cubic = &all[0].placement.positions,
                       *const simple = &all[1].placement.positions,
                       *const cluster = &all[2].placement.positions,
                       *const shells = &all[3].placement.positions;
    const Vec3 half[] = {Vec3(0, 0, 0), Vec3(0.5, 0.5, 0), Vec3(0.5, 0, 0.5), Vec3(0, 0.5, 0.5)};
    for (int i = 0; i < 108; i++)
        (*cubic)[i] =
            (Vec3(i / 4 % 3, i / 12 % 3, i / 36) + half[i % 4]) * (9.67 / 3) + Vec3(0.1, 0.2, 0.3);
    for (int i = 0; i < 27; i++) (*simple)[i] = Vec3(i % 3, i / 3 % 3, i / 9) * (6.1 / 3);
    mt19937 random(2);
    normal_distribution<double> normal(0, 3);
    for (Vec3& r : *cluster) r = Vec3(normal(random), normal(random), normal(random));
    for (int i = 0; i < 126; i++) {
        const double z = 1 - (2 * (i % 42) + 1) / 42.0, angle = 2.399963 * (i % 42),
                     rho = sqrt(1 - z * z);
        (*shells)[i] = Vec3(5 * (i / 42), 3 * (i / 42), i / 42) +
                       Vec3(rho * cos(angle), rho * sin(angle), z) * 2.5;
    }
    return all;
}

/** @param most  leaves out scenes with more particles */
void checkProducts(const vector<double>& tolerances, int most = INT_MAX) {
    vector<Scene> all = scenes();
    for (const Scene& scene : arrangements()) all.push_back(scene);
    for (const Scene& scene : all) {
        if (scene.particles.size() > most) continue;
        const MatrixXd exact = latticeSum(scene);
        const double norm = normOf(scaled(exact, scene.particles));
        // Images make large particles in a narrow box less mobile than they are alone.
        const VectorXd root = exact.diagonal().cwiseSqrt().cwiseInverse();
        const double normInBox = normOf(root.asDiagonal() * exact * root.asDiagonal());
        double worst = 0;
        for (double tolerance : tolerances) {
            const RotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0,
                                                make_shared<CpuGridFluid>());
            MatrixXd M;
            model.at(scene.placement)->dense(M);
            const double error =
                normOf(scaled(0.5 * (M + M.transpose()) - exact, scene.particles)) / norm;
            EXPECT_LE(error, tolerance)
                << scene.what << ", " << model.grid()->describe(scene.placement.box);
            EXPECT_LE(
                normOf(root.asDiagonal() * (0.5 * (M + M.transpose()) - exact) * root.asDiagonal()),
                tolerance * normInBox)
                << scene.what << " beside mobilities in the box, "
                << model.grid()->describe(scene.placement.box);
            EXPECT_LE((M - M.transpose()).norm(), 1e-14 * M.norm())
                << scene.what << " " << tolerance;
            worst = max(worst, error / tolerance);
        }
        printf("%s: errors up to %.2f of the tolerance\n", scene.what, worst);
    }
}

}  // namespace

TEST(SplitEwald, ProductsHaveTheTolerance) {
    checkProducts({1e-3});
    checkProducts({1e-8}, 40);
}
TEST(SplitEwald, FullProductsHaveEveryTolerance) {
    checkProducts({1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8});
}

TEST(SplitEwald, ThreadsDoNotChangeABit) {
    for (const Scene& scene : scenes()) {
        const VectorXd forces = VectorXd::LinSpaced(scene.particles.numRows, 1, 3);
        MatrixXd first, velocities;
        for (int threads : {1, 2, 5}) {
            const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-4, 0,
                                                make_shared<CpuGridFluid>(onThreads(threads)));
            model.at(scene.placement)->multiply(forces, velocities);
            if (threads == 1) first = velocities;
            EXPECT_EQ(velocities, first) << scene.what << " " << threads;
        }
    }
}

namespace {

/** Both parts of the mobility of a scene. */
struct SplitScene {
    const Scene& scene;
    const vector<EwaldKind> kinds;
    const SplitBox inBox;
    const EwaldSplitting& splitting;
    shared_ptr<GridFluid> fluid;
    NearField near;
    WaveField waves;
    SplitScene(const Scene& scene, double tolerance, const shared_ptr<GridFluid>& fluid,
               double xi = 0)
        : scene(scene), kinds(kindsOf(scene.particles)),
          inBox(kinds, EwaldSplitting(kinds, tolerance, 0, scene.placement.box, xi),
                scene.placement.box),
          splitting(inBox.splitting), fluid(fluid), near(scene.particles),
          waves(scene.particles, kinds) {
        vector<int> kind;
        for (double a : scene.particles.radii)
            for (size_t k = 0; k < kinds.size(); k++)
                if (kinds[k].radius == a) kind.push_back(k);
        near.setTables(inBox.tables, kind, splitting.shape);
        near.moveTo(scene.placement.positions, false, inBox.spacing, ranges());
        waves.setBox(inBox);
        waves.moveTo(scene.placement.positions, false);
    }
    Ranges ranges() const {
        return [this](int count, const function<void(int, int)>& task) {
            fluid->forRanges(count, task);
        };
    }
    MatrixXd denseOfPairs() {
        const int rows = scene.particles.numRows;
        MatrixXd M(rows, rows);
        for (int i = 0; i < rows; i++) {
            const VectorXd force = VectorXd::Unit(rows, i);
            near.multiply(force.data(), M.col(i).data(), ranges());
        }
        return M / (8 * M_PI * eta);
    }
    MatrixXd denseOfWaves(bool roughly = false) {
        const int rows = scene.particles.numRows;
        MatrixXd M = MatrixXd::Zero(rows, rows);
        for (int i = 0; i < rows; i++) {
            const VectorXd force = VectorXd::Unit(rows, i);
            waves.addProduct(*fluid, eta, roughly, force.data(), M.col(i).data());
        }
        return M;
    }
};

double smallestEigenvalue(const MatrixXd& symmetric) {
    return SelfAdjointEigenSolver<MatrixXd>(symmetric, EigenvaluesOnly).eigenvalues()[0];
}

}  // namespace

TEST(SplitEwald, BothPartsArePositive) {
    for (const Scene& scene : scenes())
        for (double tolerance : {1e-2, 1e-4}) {
            SplitScene split(scene, tolerance, make_shared<CpuGridFluid>());
            const MatrixXd pairs = split.denseOfPairs(), waves = split.denseOfWaves();
            EXPECT_LE((pairs - pairs.transpose()).norm(), 1e-14 * pairs.norm()) << scene.what;
            EXPECT_LE((waves - waves.transpose()).norm(), 1e-14 * waves.norm()) << scene.what;
            // The matrix of the waves is a Gram matrix, whatever is cut off. For the matrix of the
            // pairs, the cut-off has an effect of a part of the tolerance.
            const double rounding = 1e-13;
            EXPECT_GE(smallestEigenvalue(scaled(waves, scene.particles)),
                      -rounding * normOf(scaled(waves, scene.particles)))
                << scene.what;
            EXPECT_GE(smallestEigenvalue(scaled(pairs, scene.particles)), -0.3 * tolerance)
                << scene.what;
        }
}

TEST(SplitEwald, PairsDoNotDependOnTheCells) {
    // The expected matrix is the sum over all images of all pairs, by the functions themselves.
    for (const Scene& scene : scenes()) {
        SplitScene split(scene, 1e-4, plainFluid());
        const HydrodynamicParticles& particles = scene.particles;
        const Lattice lattice(scene.placement.box);
        const double largest = split.kinds.back().radius;
        const vector<Vector3d> images =
            lattice.within(split.splitting.gap + 2 * largest + lattice.getReach());
        MatrixXd expected = MatrixXd::Zero(particles.numRows, particles.numRows);
        for (int i = 0; i < particles.size(); i++)
            for (int j = 0; j < particles.size(); j++) {
                const double a = particles.radii[i], b = particles.radii[j];
                const NearPair functions(a, b, split.splitting.xi, true);
                PairBlocks pair;
                pair.setZero();
                const Vector3d nearest =
                    lattice.wrapped(scene.placement.positions[i] - scene.placement.positions[j]);
                for (const Vector3d& image : images)
                    if ((nearest + image).norm() < split.splitting.gap + a + b)
                        pair.add(functions.at((nearest + image).norm()), nearest + image, false);
                const int row = particles.firstRow[i], column = particles.firstRow[j];
                expected.block<3, 3>(row, column) = pair.tt;
                if (particles.hasTorque[i]) expected.block<3, 3>(row + 3, column) = pair.rt;
                if (particles.hasTorque[j]) expected.block<3, 3>(row, column + 3) = pair.tr;
                if (particles.hasTorque[i] && particles.hasTorque[j])
                    expected.block<3, 3>(row + 3, column + 3) = pair.rr;
            }
        expected /= 8 * M_PI * eta;
        EXPECT_LE((split.denseOfPairs() - expected).norm(), 1e-10 * expected.norm()) << scene.what;
    }
}

TEST(SplitEwald, FieldsOfWavesHaveTheCovarianceOfProducts) {
    for (const BoxVectors& box : {orthogonal(3.1, 2.6, 4.4), leaning(3.1, 2.6, 4.4, 1.4, 0, 0)}) {
        const Scene mixed("unequal spheres and blobs", 4, box, Scene::Mixed, {0.5, 0.8}, 5);
        for (bool fast : {false, true}) {
            SplitScene split(mixed, 1e-2, fast ? make_shared<CpuGridFluid>() : plainFluid());
            const MatrixXd M = split.denseOfWaves();
            vector<GridField> fields;
            const array<int, 3>& size = split.splitting.shape.size;
            const MatrixXd covariance =
                covarianceOfFields(size, M.rows(), -size[1] / 2, CounterModeNoise::isMirrored,
                                   [&](const UnitNoise& noise) {
                                       split.waves.draw(*split.fluid, eta, noise, fields);
                                       VectorXd column = VectorXd::Zero(M.rows());
                                       split.waves.addAverages(*split.fluid, fields, column.data());
                                       return column;
                                   });
            EXPECT_LE((covariance - M).norm(), 1e-12 * M.norm());
        }
    }
}

TEST(SplitEwald, FastGridsArePlainOnesToRounding) {
    for (const Scene& scene : scenes()) {
        SplitScene plain(scene, 1e-3, plainFluid()), fast(scene, 1e-3, make_shared<CpuGridFluid>());
        const MatrixXd M = plain.denseOfWaves();
        EXPECT_LE((fast.denseOfWaves() - M).norm(), 1e-13 * M.norm()) << scene.what;
        const MatrixXd rough = fast.denseOfWaves(true);
        EXPECT_LE(normOf(scaled(0.5 * (rough + rough.transpose()) - M, scene.particles)),
                  Accuracy::errorOfSinglePrecision * normOf(scaled(M, scene.particles)))
            << scene.what;
        EXPECT_GT((rough - M).norm(), 0);
        const NoiseStream noise;
        MatrixXd averages(M.rows(), 2);
        averages.setZero();
        SplitScene* const both[2] = {&plain, &fast};
        for (int i = 0; i < 2; i++) {
            vector<GridField> fields;
            both[i]->waves.draw(*both[i]->fluid, eta, noise, NoiseStream::RandomField, fields);
            both[i]->waves.addAverages(*both[i]->fluid, fields, averages.col(i).data());
        }
        EXPECT_LE((averages.col(0) - averages.col(1)).norm(), 1e-12 * averages.col(0).norm())
            << scene.what;
        EXPECT_GT(averages.col(0).norm(), 0);
    }
}

TEST(SplitEwald, BoxesAwayMakeNoDifference) {
    for (const Scene& scene : scenes()) {
        if (scene.particles.size() > 40) continue;
        const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-4, 0,
                                            make_shared<CpuGridFluid>());
        Placement away = scene.placement;
        for (size_t i = 0; i < away.positions.size(); i++)
            for (int axis = 0; axis < 3; axis++)
                away.positions[i] += away.box[axis] * (((int)(7 * i + axis) % 5 - 2) * 64.0);
        MatrixXd here, there;
        model.at(scene.placement)->dense(here);
        model.at(away)->dense(there);
        EXPECT_LE((there - here).norm(), 1e-11 * here.norm()) << scene.what;
    }
}

TEST(SplitEwald, PlacesNearbyKeepTheirPairs) {
    // Central differences of products converge as the square of their step. One pair more or less
    // would make an error of tolerance/step.
    const Scene scene("unequal spheres and blobs", 36, orthogonal(9, 12, 10), Scene::Mixed,
                      {1, 1.4}, 5);
    const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-2, 0, plainFluid());
    const VectorXd forces = VectorXd::LinSpaced(scene.particles.numRows, -1, 2);
    mt19937 random(9);
    normal_distribution<double> normal;
    vector<Vec3> direction;
    for (int i = 0; i < scene.particles.size(); i++)
        direction.push_back(Vec3(normal(random), normal(random), normal(random)));
    const auto difference = [&](double step) {
        unique_ptr<MobilityAt> at = model.at(scene.placement);
        MatrixXd ends[2], unused;
        at->multiply(forces, unused);
        for (int side = 0; side < 2; side++) {
            Placement moved = scene.placement;
            for (size_t i = 0; i < direction.size(); i++)
                moved.positions[i] += direction[i] * ((side - 0.5) * step);
            // The anchors of a nearby placement are those of the placement before.
            model.place(at, scene.placement);
            model.placeNear(at, moved);
            at->multiply(forces, ends[side]);
        }
        return MatrixXd((ends[1] - ends[0]) / step);
    };
    const MatrixXd exact = difference(1e-4);
    double before = 0;
    for (double step : {0.04, 0.02, 0.01}) {
        const double error = (difference(step) - exact).norm() / exact.norm();
        if (before > 0) {
            EXPECT_LT(error, 0.35 * before) << step;
        }
        before = error;
    }
    EXPECT_LT(before, 1e-3);
}

namespace {

/** The part of a field that belongs to the pairs, by dense matrices, in units of the particles' own
 * mobilities. To the matrix of the pairs 0.3 tolerances of these own mobilities are added. */
struct PairsOfField {
    VectorXd slips, forces;

    PairsOfField(SplitScene& split, double tolerance, const NoiseStream& noise) {
        const HydrodynamicParticles& particles = split.scene.particles;
        VectorXd W(particles.numRows);
        for (int i = 0; i < particles.size(); i++)
            for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k++) {
                double pair[2];
                noise.pair(NoiseStream::ParticleFirstDraw, i, k / 2, pair[0], pair[1]);
                W[particles.firstRow[i] + k] = pair[k % 2];
            }
        const MatrixXd pairs =
            scaled(split.denseOfPairs(), particles) +
            0.3 * tolerance * MatrixXd::Identity(particles.numRows, particles.numRows);
        const SelfAdjointEigenSolver<MatrixXd> solver(pairs);
        slips = solver.operatorSqrt() * W;
        forces = solver.operatorInverseSqrt() * W;
    }
};

}  // namespace

TEST(SplitEwald, FieldsAreThoseOfWavesAndARootOfPairs) {
    // The covariance of the waves is tested above. Together with the symmetric root of the pairs
    // that is tested here, the slips have the covariance M.
    const double tolerance = 1e-3;
    NoiseStream noise, ofWaves;
    ofWaves.field = 1;  // of the group of particle 0
    for (const Scene& scene : scenes()) {
        const HydrodynamicParticles& particles = scene.particles;
        SplitScene split(scene, tolerance, plainFluid());
        const RotnePragerYamakawaGrid model(particles, eta, tolerance, 0, split.fluid);
        unique_ptr<RandomField> field;
        model.randomField()->draw(noise, NoiseStream::ParticleFirstDraw, scene.placement.box,
                                  field);
        MatrixXd slips, again, others;
        field->slipsAt(scene.placement, false, slips);

        VectorXd waves = VectorXd::Zero(particles.numRows);
        vector<GridField> fields;
        split.waves.draw(*split.fluid, eta, ofWaves, NoiseStream::ParticleFirstDraw, fields);
        split.waves.addAverages(*split.fluid, fields, waves.data());
        const VectorXd expected = PairsOfField(split, tolerance, noise).slips;
        const VectorXd found = roots(particles).asDiagonal() * (slips.col(0) - waves);
        EXPECT_LE((found - expected).norm(), 5 * 0.1 * tolerance * expected.norm()) << scene.what;
        EXPECT_GT(waves.norm(), 0);

        // The field is the same after it was evaluated at other places and nearby.
        Placement nearby = scene.placement;
        for (Vec3& r : nearby.positions) r += Vec3(1e-3, 0, -1e-3);
        field->slipsAt(nearby, true, others);
        EXPECT_LE((others - slips).norm(), 0.05 * slips.norm()) << scene.what;
        EXPECT_GT((others - slips).norm(), 0) << scene.what;
        field->slipsAt(scene.placement, false, again);
        EXPECT_EQ(again, slips) << scene.what;
        EXPECT_EQ(field->getNumRandomNumbers(),
                  GridModeNoise::numbersOf(split.splitting.shape) + particles.numRows);
    }
}

namespace {

/** Points of a sphere's surface and their weights, which add up to 1: Gauss's weights for the
 * height, equal weights for the angle. */
struct SurfaceRule {
    vector<Vector3d> normals;
    vector<double> weights;

    explicit SurfaceRule(int number) {
        MatrixXd recurrence = MatrixXd::Zero(number, number);
        for (int i = 1; i < number; i++)
            recurrence(i, i - 1) = recurrence(i - 1, i) = i / sqrt(4.0 * i * i - 1);
        const SelfAdjointEigenSolver<MatrixXd> heights(recurrence);
        for (int i = 0; i < number; i++)
            for (int j = 0; j < 2 * number; j++) {
                const double z = heights.eigenvalues()[i], around = M_PI * (j + 0.5) / number;
                normals.push_back(
                    Vector3d(sqrt(1 - z * z) * cos(around), sqrt(1 - z * z) * sin(around), z));
                weights.push_back(pow(heights.eigenvectors()(0, i), 2) / (2 * number));
            }
    }
};

/** Spheres and blobs of four radii that do not overlap, one across a face of the box. */
Scene apart(double tilt = 0) {
    Scene scene("apart", 4, leaning(9, 10, 8, tilt, 0, 0), Scene::Mixed, {1, 0.6, 1.3, 0.8}, 1);
    scene.placement.positions = {Vec3(1, 2, 3), Vec3(2.5, 2.8, 3.4), Vec3(4.5, 5, 7.8),
                                 Vec3(7, 8, 1)};
    return scene;
}

}  // namespace

/**
 * Particles move with the average of a field's flow over their surfaces, and turn with the average
 * of its moment, so flow and slips belong to one field.
 */
TEST(SplitEwald, FlowsOfFieldsHaveTheSlipsForAverages) {
    const SurfaceRule rule(24);
    const pair<double, double> cases[] = {{1e-3, 0}, {1e-6, 0}, {1e-3, -4}};
    for (const auto& [tolerance, tilt] : cases) {
        const Scene scene = apart(tilt);
        const HydrodynamicParticles& particles = scene.particles;
        const RotnePragerYamakawaGrid model(particles, eta, tolerance, 0, plainFluid());
        unique_ptr<RandomField> field;
        model.randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw,
                                  scene.placement.box, field);
        MatrixXd slips;
        field->slipsAt(scene.placement, false, slips);
        VectorXd averages = VectorXd::Zero(particles.numRows);
        for (int p = 0; p < particles.size(); p++) {
            const double a = particles.radii[p];
            vector<Vec3> points;
            for (const Vector3d& n : rule.normals)
                points.push_back(scene.placement.positions[p] + Vec3(n[0], n[1], n[2]) * a);
            Velocities flow = Velocities::Zero(3, points.size());
            field->addFlowAt(points, 1, flow);
            const int row = particles.firstRow[p];
            for (size_t i = 0; i < points.size(); i++) {
                const Vector3d v = rule.weights[i] * flow.col(i), n = rule.normals[i];
                averages.segment<3>(row) += v;
                if (particles.hasTorque[p]) averages.segment<3>(row + 3) += 1.5 / a * n.cross(v);
            }
        }
        // The flow of pairs is that of forces. Sums over pairs and flows leave out distant pairs in
        // different ways, with an error of up to one tolerance each. To the sums over pairs 0.3
        // tolerances are added.
        SplitScene split(scene, tolerance, plainFluid());
        const PairsOfField pairs(split, tolerance, NoiseStream());
        const VectorXd root = roots(particles);
        EXPECT_LE(
            (root.asDiagonal() * (averages - slips.col(0))).norm(),
            tolerance * ((root.asDiagonal() * slips.col(0)).norm() + 2.3 * pairs.forces.norm()));
        EXPECT_GT(pairs.slips.norm(), 0.1 * (root.asDiagonal() * slips.col(0)).norm());
    }
}

namespace {

/** The amplitude of a field along a wave is the component of its flow, by a sum over a lattice of
 * points. In a triclinic box only some waves along the axes are periodic. */
void checkAmplitudes(const Scene& scene) {
    const BoxVectors& box = scene.placement.box;
    const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-3, 0, make_shared<CpuGridFluid>());
    unique_ptr<RandomField> field;
    model.randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw, box, field);
    MatrixXd slips;
    field->slipsAt(scene.placement, false, slips);
    const int number = 28;
    vector<Vec3> points;
    for (int i = 0; i < number * number * number; i++)
        points.push_back(box[0] * ((i % number + 0.5) / number) +
                         box[1] * ((i / number % number + 0.5) / number) +
                         box[2] * ((i / number / number + 0.5) / number));
    Velocities flow = Velocities::Zero(3, points.size());
    field->addFlowAt(points, 1, flow);
    for (int a = 0; a < 3; a++)
        for (int periods : {1, 3}) {
            if (a == 2 && fmod(periods * box[1][0] / box[0][0], 1) != 0) continue;
            DrivenFlow wave;
            wave.waveVelocity = 1;
            wave.forceAxis = a;
            wave.waveAxis = (a + 1) % 3;
            wave.k = 2 * M_PI * periods / box[wave.waveAxis][wave.waveAxis];
            wave.phase = 0.4 + a;
            double sum = 0;
            for (size_t i = 0; i < points.size(); i++)
                sum += flow(a, i) * sin(wave.k * points[i][wave.waveAxis] + wave.phase);
            sum *= 2.0 / points.size();
            const double found = field->amplitudeOf(wave);
            // At surfaces flows have kinks, which the lattice resolves only to the distance of its
            // points.
            EXPECT_NEAR(found, sum, 1e-3 * slips.topRows<3>().norm()) << a << " " << periods;
        }
}

}  // namespace

TEST(SplitEwald, AmplitudesOfFieldsAreThoseOfTheirFlows) { checkAmplitudes(apart()); }
TEST(SplitEwald, AmplitudesOfFieldsInASkewBoxAreThoseOfTheirFlows) { checkAmplitudes(apart(3)); }

TEST(SplitEwald, FieldsAndProductsShareNoResults) {
    // Products are the same bit for bit, whatever products and fields were evaluated before, and
    // whatever these kept.
    const Scene scene("unequal spheres and blobs", 36, orthogonal(9, 12, 10), Scene::Mixed,
                      {1, 1.4}, 5);
    Placement other = scene.placement, smaller = scene.placement;
    for (Vec3& r : other.positions) r += Vec3(0.3, -0.2, 0.1) * r[0];
    smaller.box = orthogonal(8, 11, 12);
    const VectorXd forces = VectorXd::LinSpaced(scene.particles.numRows, -1, 2);
    const auto fresh = [&](const Placement& placement) {
        const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-3, 0, plainFluid());
        MatrixXd velocities;
        model.at(placement)->multiply(forces, velocities);
        return velocities;
    };
    const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-3, 0, plainFluid());
    unique_ptr<MobilityAt> a = model.at(scene.placement), b = model.at(other);
    unique_ptr<RandomField> field;
    MatrixXd velocities, slips;
    for (int round = 0; round < 2; round++)
        for (const Placement* placement :
             vector<const Placement*>{&scene.placement, &other, &smaller}) {
            model.randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw, placement->box,
                                      field);
            field->slipsAt(*placement, false, slips);
            model.place(a, *placement);
            a->multiply(forces, velocities);
            EXPECT_EQ(velocities, fresh(*placement));
            b->multiply(forces, velocities);
            EXPECT_EQ(velocities, fresh(other));
            model.place(a, other);
            model.placeNear(a, scene.placement);
            a->multiply(forces, velocities);
            field->slipsAt(scene.placement, true, slips);
            b->multiply(forces, velocities);
            EXPECT_EQ(velocities, fresh(other));
        }
}

TEST(SplitEwald, ASplittingByHandIsRightToo) {
    // The splitting parameter affects the time, not the accuracy.
    const Scene scene("unequal spheres and blobs", 36, orthogonal(9, 12, 10), Scene::Mixed,
                      {1, 1.4}, 5);
    const MatrixXd exact = latticeSum(scene);
    const double norm = normOf(scaled(exact, scene.particles));
    for (double tolerance : {1e-2, 1e-5})
        for (double xi : {0.2, 0.4, 0.8}) {
            SplitScene split(scene, tolerance, plainFluid(), xi);
            ASSERT_EQ(split.splitting.xi, xi);
            const MatrixXd M = split.denseOfPairs() + split.denseOfWaves();
            EXPECT_LE(normOf(scaled(0.5 * (M + M.transpose()) - exact, scene.particles)),
                      tolerance * norm)
                << tolerance << " " << xi;
        }
}

TEST(SplitEwald, ASkewBoxIsItsLattice) {
    // Boxes that lean by whole edges more are the same lattice. The grid of a shear has one size.
    const double L = 8.5;
    Scene scene("blobs", 40, orthogonal(L, L, L), Scene::Blobs, {1}, 19);
    for (double tolerance : {1e-3, 1e-6}) {
        const RotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0, plainFluid());
        for (double tilt : {0.5, 0.2}) {
            MatrixXd M[2];
            for (int more = 0; more < 2; more++) {
                Placement placement = scene.placement;
                placement.box[1][0] = (tilt - more) * L;
                model.at(placement)->dense(M[more]);
            }
            EXPECT_LE(normOf(scaled(0.5 * (M[1] + M[1].transpose() - M[0] - M[0].transpose()),
                                    scene.particles)),
                      2 * tolerance * normOf(scaled(M[0], scene.particles)))
                << tolerance << " " << tilt;
        }
        const array<int, 3> size = model.splittingFor(leaning(L, L, L, 0.5 * L, 0, 0)).shape.size;
        for (double tilt : {-0.5, -0.3, 1e-6, 0.4})
            EXPECT_EQ(model.splittingFor(leaning(L, L, L, tilt * L, 0, 0)).shape.size, size);
    }
}

TEST(SplitEwald, FieldsAreThoseOfTheBoxWhereTheyAreAskedFor) {
    // A field that was drawn in one box has in another box the slips of one that was drawn there,
    // and goes on smoothly where a tilt flips.
    const double L = 8.5;
    Scene scene("mixed", 12, orthogonal(L, L, L), Scene::Mixed, {1, 0.7}, 20);
    for (Vec3& r : scene.placement.positions) r += Vec3(3, 4, -5) * L;
    const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-3, 0, plainFluid());
    const auto slipsAt = [&](const BoxVectors& drawn, const BoxVectors& asked) {
        unique_ptr<RandomField> field;
        model.randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw, drawn, field);
        Placement there = scene.placement;
        there.box = asked;
        MatrixXd slips;
        field->slipsAt(there, false, slips);
        return slips;
    };
    const auto tilted = [&](double tilt) { return leaning(L, L, L, tilt * L, 0, 0); };
    const pair<double, double> tilts[] = {{0, 0.1}, {0.1, 0}, {0.2, 0.25}};
    for (const auto& [from, to] : tilts)
        EXPECT_EQ(slipsAt(tilted(from), tilted(to)), slipsAt(tilted(to), tilted(to)));
    const MatrixXd before = slipsAt(tilted(0.4999), tilted(0.4999));
    const MatrixXd after = slipsAt(tilted(0.4999), tilted(-0.4999));
    EXPECT_LE((after - before).norm(), 0.01 * before.norm());
    EXPECT_GT((slipsAt(tilted(-0.4999), tilted(-0.4999)) - before).norm(), 0.1 * before.norm());
}
