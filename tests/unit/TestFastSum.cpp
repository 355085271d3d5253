// Products by multipoles agree with sums over all pairs within the requested error. Further tests
// are of parts of the method, such as solid harmonics.

#include <openmm/internal/ThreadPool.h>
#include "simd/SimdTargets.h"  // must precede Highway

#include "Instrumented.h"
#include "TestSupport.h"
#include "hwy/targets.h"
#include "mobility/fastsum/FastSum.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

enum Kind { Blobs, Spheres, Mixed };

struct Scene {
    HydrodynamicParticles particles;
    vector<Vec3> positions;
    bool hasWall = false;

    void add(mt19937& random, const Vec3& r, double radius, Kind kind) {
        uniform_real_distribution<double> u(0, 1);
        particles.add(radius, kind == Spheres || (kind == Mixed && u(random) < 0.5),
                      particles.size(), -1);
        positions.push_back(r);
    }
    CpuRotnePragerYamakawa model(bool fastSums = true) const {
        optional<NoSlipPlane> wall;
        if (hasWall) wall.emplace(0, false);
        return CpuRotnePragerYamakawa(particles, 0.7, {}, wall, fastSums);
    }
    /**
     * Square roots of the particles' own frictions, up to a common factor. Multiplied by these
     * roots, forces and torques of unit size have the same strength.
     */
    VectorXd scale() const {
        VectorXd s(particles.numRows);
        for (int i = 0; i < particles.size(); i++) {
            const double a = particles.radii[i];
            s.segment<3>(particles.firstRow[i]).setConstant(sqrt(a));
            if (particles.hasTorque[i])
                s.segment<3>(particles.firstRow[i] + 3).setConstant(sqrt(4.0 / 3.0 * a * a * a));
        }
        return s;
    }
};

/** @param size  of a cube in which particles are at random, standing on z = `bottom` */
Scene cloud(int n, Kind kind, bool equalRadii, bool hasWall, double size, double bottom = 0) {
    mt19937 random(n + 10 * kind + equalRadii);
    uniform_real_distribution<double> u(0, 1);
    Scene scene;
    scene.hasWall = hasWall;
    for (int i = 0; i < n; i++) {
        const double a = equalRadii ? 1.0 : 0.3 + 1.2 * u(random);
        scene.add(random,
                  size * Vec3(u(random), u(random), u(random)) + Vec3(0, 0, bottom + 1.001 * a), a,
                  kind);
    }
    return scene;
}

/** Scenes that the table of accuracies was not made from. */
enum Held { Slab, Line, TwoClouds, Ring, HighAbove, Layer, Dilute, ChainOfBlobs };
const Held allHeld[] = {Slab, Line, TwoClouds, Ring, HighAbove, Layer, Dilute, ChainOfBlobs};
Scene heldOut(int n, Held shape, Kind kind, bool hasWall) {
    mt19937 random(77 + shape);
    uniform_real_distribution<double> u(0, 1);
    normal_distribution<double> g;
    Scene scene;
    scene.hasWall = hasWall;
    const double L = cbrt(20.0 * n);
    Vec3 last(0, 0, 40 + sqrt(n));
    for (int i = 0; i < n; i++) {
        const double a = shape == Line || shape == TwoClouds ? 0.4 + 0.9 * u(random) : 1.0;
        Vec3 r;
        if (shape == Slab) r = Vec3(3 * L * u(random), 0.5 * L * u(random), 0.2 * L * u(random));
        if (shape == Line) r = Vec3(2.0 * i / 3, 2 * g(random), 2 * g(random) + 8);
        if (shape == TwoClouds)
            r = 0.25 * L * Vec3(g(random), g(random), g(random)) +
                Vec3(i % 2 ? 6 * L : 0, 0, 2 * L);
        if (shape == Ring) {
            const double phi = 2 * M_PI * u(random), R = n / 8.0;
            r = Vec3(R * cos(phi), R * sin(phi), 3 + 3 * u(random));
        }
        if (shape == HighAbove) r = L * Vec3(u(random), u(random), u(random)) + Vec3(0, 0, 3.1 * L);
        if (shape == Layer)
            r = sqrt(4.0 * n) * Vec3(u(random), u(random), 0) + Vec3(0, 0, 0.5 * u(random));
        if (shape == Dilute) r = 8 * L * Vec3(u(random), u(random), u(random));
        if (shape == ChainOfBlobs) {
            Vec3 step(g(random), g(random), g(random));
            r = last + step * (1.6 / sqrt(step.dot(step)));
            last = r;
        }
        r[2] = max(r[2], 0.0) + 1.001 * a;
        scene.add(random, r, a, kind);
    }
    return scene;
}

/**
 * Three columns of forces, scaled by the particles' own frictions. The first column is random. In
 * the others all forces have one direction, for which M is largest.
 */
MatrixXd forcesFor(const Scene& scene) {
    mt19937 random(5);
    normal_distribution<double> g;
    MatrixXd forces = MatrixXd::Zero(scene.particles.numRows, 3);
    const VectorXd scale = scene.scale();
    for (int i = 0; i < scene.particles.size(); i++) {
        const int row = scene.particles.firstRow[i], count = scene.particles.hasTorque[i] ? 6 : 3;
        for (int k = 0; k < count; k++) forces(row + k, 0) = scale[row + k] * g(random);
        forces(row, 1) = scale[row];
        forces(row + 2, 2) = scale[row + 2];
    }
    return forces;
}

MatrixXd exactly(const Scene& scene, const MatrixXd& forces) {
    const CpuRotnePragerYamakawa model = scene.model(false);
    MatrixXd velocities;
    model.at({scene.positions})->multiply(forces, velocities);
    return velocities;
}
MatrixXd fast(const Scene& scene, const MatrixXd& forces, const FastSum::Accuracy& accuracy,
              const FastSum::ForRanges& forRanges = {}) {
    FastSum sum(scene.particles, scene.hasWall, accuracy, forRanges);
    sum.moveTo(scene.positions, vector<double>(scene.particles.size(), 1.0));
    MatrixXd velocities;
    sum.apply(forces, 1 / (8 * M_PI * 0.7), velocities);
    return velocities;
}

/** The least number of particles for which sums to this error are fast ones. */
int fewestAt(double error, bool hasWall) {
    int n = 1000;
    while (!FastSum::choose(error, n, hasWall)) n += 1000;
    return n;
}

}  // namespace

TEST(SolidHarmonics, ShiftsAndTakesFromFar) {
    const SolidHarmonics harmonics(18);
    const int size = harmonics.size();
    const Vector3d x(0.3, -0.5, 0.2), y(-0.4, 0.1, 0.6), d(0.7, 0.2, -0.9), D(2.1, -1.9, 1.5);
    VectorXd Rx(size), Ry(size), shifted(size);
    harmonics.basis(x[0], x[1], x[2], Rx.data());
    harmonics.basis(y[0], y[1], y[2], Ry.data());
    const Vector3d u = x + d;
    harmonics.basis(u[0], u[1], u[2], shifted.data());
    EXPECT_LT((harmonics.shift(d) * Rx - shifted).cwiseAbs().maxCoeff(), 1e-15);
    // The terms that are cut off are (|x|/|D|)^19 and (|y|/|D|)^19, about 1e-12.
    EXPECT_NEAR(Rx.dot(harmonics.fromFar(D) * Ry), 1 / (D + x - y).norm(), 1e-11);
}

TEST(SolidHarmonics, Derivatives) {
    const SolidHarmonics harmonics(9);
    const int size = harmonics.size();
    const double h = 1e-4;
    const Vector3d x(0.6, -0.7, 0.5);
    VectorXd R(size), forward(size), back(size), local(size), moments(size);
    harmonics.basis(x[0], x[1], x[2], R.data());
    for (int k = 0; k < 3; k++) {
        Vector3d e = h * Vector3d::Unit(k);
        harmonics.basis(x[0] + e[0], x[1] + e[1], x[2] + e[2], forward.data());
        harmonics.basis(x[0] - e[0], x[1] - e[1], x[2] - e[2], back.data());
        const VectorXd slope = (forward - back) / (2 * h), L = VectorXd::LinSpaced(size, -1, 2);
        moments.setZero();
        harmonics.addDerivativeOfMoments(k, 1, R.data(), moments.data());
        EXPECT_LT((moments - slope).cwiseAbs().maxCoeff(), 1e-8);
        harmonics.derivativeOfLocal(k, L.data(), local.data());
        EXPECT_NEAR(local.dot(R), L.dot(slope), 1e-7);
        Vector3d mirrored = x;
        mirrored[k] *= -1;
        harmonics.basis(mirrored[0], mirrored[1], mirrored[2], forward.data());
        for (int a = 0; a < size; a++) EXPECT_EQ(forward[a], harmonics.signs(1 << k)[a] * R[a]);
    }
}

TEST(ClusterTree, EveryPairIsInOnePairOfCubes) {
    for (bool hasWall : {false, true})
        for (double bottom : {0.0, 50.0}) {
            Scene scene = cloud(400, Mixed, false, hasWall, 20, bottom);
            // A patch beside the cloud: if it lies on the wall, so do the cubes that hold it.
            mt19937 random(1);
            for (int i = 0; i < 9; i++)
                scene.add(random, Vec3(0.7 * (i % 3) - 5, 0.7 * (i / 3) - 5, bottom + 0.35), 0.3,
                          Mixed);
            ClusterTree tree;
            tree.build(scene.positions, scene.particles.radii, scene.particles.hasTorque, hasWall,
                       {6, 0.7});
            const int n = scene.particles.size(), numCells = tree.cells.size();
            Eigen::MatrixXi times = Eigen::MatrixXi::Zero(n, n), imageTimes = times;
            const auto count = [&](Eigen::MatrixXi& in, int target, int source) {
                for (int i = tree.cells[target].first; i < tree.cells[target].end; i++)
                    for (int j = tree.cells[source].first; j < tree.cells[source].end; j++)
                        in(i, j)++;
            };
            for (size_t l = 0; l < tree.leaves.size(); l++)
                for (int k = tree.firstNear[l]; k < tree.firstNear[l + 1]; k++) {
                    count(times, tree.leaves[l], tree.near[k]);
                    count(imageTimes, tree.leaves[l], tree.near[k]);
                }
            int onWall = 0;
            for (const auto& of : tree.classes)
                for (int p = of.first; p < of.end; p++) {
                    const auto& pair = tree.farPairs[p];
                    const bool image = pair.source >= numCells;
                    const auto &to = tree.cells[pair.target],
                               &from = tree.cells[pair.source % numCells];
                    count(image ? imageTimes : times, pair.target, pair.source % numCells);
                    if (from.onWall) count(imageTimes, pair.target, pair.source);
                    onWall += from.onWall;
                    Vector3d place = from.centre;
                    if (image) place[2] *= -1;
                    ASSERT_LT((of.D * from.half - (to.centre - place)).norm(),
                              1e-12 * (1 + place.norm()));
                }
            EXPECT_GT(tree.farPairs.size(), 1000u);
            EXPECT_EQ(times.minCoeff(), 1);
            EXPECT_EQ(times.maxCoeff(), 1);
            EXPECT_EQ(onWall > 0, hasWall && bottom == 0);
            if (!hasWall) continue;
            EXPECT_EQ(imageTimes.minCoeff(), 1);
            EXPECT_EQ(imageTimes.maxCoeff(), 1);
        }
}

namespace {

void checkDifferences(const vector<double>& errors) {
    mt19937 random(3);
    uniform_real_distribution<double> u(0, 1);
    normal_distribution<double> g;
    const auto vector3 = [&](auto&& draw) {
        const double x = draw(), y = draw(), z = draw();
        return Vec3(x, y, z);
    };
    for (double error : errors)
        for (bool hasWall : {false, true}) {
            double worst = 0;
            for (Kind kind : {Blobs, Spheres})
                for (int blobs : {1, 9})
                    for (double step : {1e-6, 1e-2}) {
                        Scene scene;
                        scene.hasWall = hasWall;
                        vector<Vec3> displaced[2];
                        for (int body = 0; body < 1200 / blobs; body++) {
                            const Vec3 place = 35 * vector3([&] { return u(random); }),
                                       by = step * vector3([&] { return g(random); });
                            for (int i = 0; i < blobs; i++) {
                                const Vec3 r = place + Vec3(1.7 * (i % 3), 1.7 * (i / 3), 1.1);
                                scene.add(random, r, 1, kind);
                                displaced[0].push_back(r - 0.5 * by);
                                displaced[1].push_back(r + 0.5 * by);
                            }
                        }
                        const MatrixXd forces = forcesFor(scene).leftCols(1);
                        FastSum::Accuracy accuracy =
                            *FastSum::choose(error, numeric_limits<int>::max(), hasWall);
                        accuracy.floats = 0;
                        FastSum sum(scene.particles, hasWall, accuracy, {});
                        const vector<double> weights(scene.particles.size(), 1.0);
                        sum.moveTo(scene.positions, weights);
                        MatrixXd found[2], exact[2];
                        for (int end : {0, 1}) {
                            sum.displaceTo(displaced[end], weights);
                            sum.apply(forces, 1 / (8 * M_PI * 0.7), found[end]);
                            scene.positions = displaced[end];
                            exact[end] = exactly(scene, forces);
                        }
                        const VectorXd scale = scene.scale(),
                                       difference = scale.asDiagonal() * (exact[1] - exact[0]);
                        const VectorXd wrong =
                            scale.asDiagonal() * (found[1] - found[0]) - difference;
                        const double relative = wrong.norm() / difference.norm();
                        worst = max(worst, relative / error);
                        EXPECT_LT(relative, error) << hasWall << kind << blobs << " " << step;
                    }
            cout << "error " << error << (hasWall ? ", wall" : "") << ": differences have at most "
                 << worst << " of it" << endl;
        }
}

}  // namespace

/**
 * Differences of products at two placements with the same cubes have about the relative error of
 * products, for displacements of any size. Rigid bodies are the hard case: their own pairs, which
 * are summed directly, do not change.
 */
TEST(FastSum, DifferencesWithTheSameCubes) { checkDifferences({1e-2, 1e-4, 1e-6}); }
TEST(FastSum, FullDifferencesAtOtherErrors) { checkDifferences({1e-3, 1e-5}); }

// For all kinds of particles errors go to zero with increasing order, so the formulas are right.
TEST(FastSum, ConvergesToTheSumOverPairs) {
    for (bool hasWall : {false, true})
        for (Kind kind : {Blobs, Spheres, Mixed})
            for (bool equalRadii : {true, false}) {
                if (isInstrumented() && (kind != Mixed || equalRadii)) continue;
                const Scene scene = cloud(300, kind, equalRadii, hasWall, 21);
                const MatrixXd forces = forcesFor(scene), exact = exactly(scene, forces);
                const VectorXd scale = scene.scale();
                double before = 1;
                for (int order : {3, 6, 10}) {
                    const MatrixXd error = fast(scene, forces, {order, 0.55, 6, 0}) - exact;
                    const double relative =
                        (scale.asDiagonal() * error).norm() / (scale.asDiagonal() * exact).norm();
                    EXPECT_LT(relative, 0.2 * before) << order << " " << kind << " " << hasWall;
                    before = relative;
                }
                EXPECT_LT(before, 1e-5) << kind << " " << hasWall;
                EXPECT_LT((fast(scene, forces, {2, 0.55, 500, 0}) - exact).norm(),
                          1e-14 * exact.norm());
            }
}

namespace {

/** Errors keep below the promised bound at scenes that the table of accuracies was not made from.
 */
void checkErrorsOfSums(int n) {
    for (bool hasWall : {false, true})
        for (Held shape : allHeld) {
            const Scene scene = heldOut(n, shape, Kind(shape % 3), hasWall);
            const VectorXd scale = scene.scale();
            const MatrixXd forces = forcesFor(scene),
                           exact = scale.asDiagonal() * exactly(scene, forces);
            // The norm of M is at least the ratio of the norms of products and forces.
            const VectorXd sizes = (scale.cwiseInverse().asDiagonal() * forces).colwise().norm();
            const double norm = exact.colwise().norm().transpose().cwiseQuotient(sizes).maxCoeff();
            for (double error : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6}) {
                const FastSum::Accuracy* accuracy = FastSum::choose(error, 1000000, hasWall);
                ASSERT_TRUE(accuracy);
                const MatrixXd found = scale.asDiagonal() * fast(scene, forces, *accuracy);
                for (int c = 0; c < forces.cols(); c++)
                    EXPECT_LT((found - exact).col(c).norm(), error * norm * sizes[c])
                        << shape << " " << error << " " << hasWall << " " << c;
                EXPECT_LT((found - exact).col(0).norm(), error * exact.col(0).norm())
                    << shape << " " << error << " " << hasWall;
                // M is symmetric to that error: f.(M g) = g.(M f).
                const MatrixXd products =
                    forces.transpose() * scale.cwiseInverse().asDiagonal() * found;
                EXPECT_LT(abs(products(0, 1) - products(1, 0)),
                          2 * error * norm * sizes[0] * sizes[1]);
            }
        }
}

}  // namespace

TEST(FastSum, ErrorsAreBelowWhatWasAskedFor) { checkErrorsOfSums(1500); }
TEST(FastSum, FullErrorsOfLargerSumsAreBelowWhatWasAskedFor) { checkErrorsOfSums(12000); }

TEST(FastSum, ChoosesByNumbersAlone) {
    for (bool hasWall : {false, true}) {
        EXPECT_FALSE(FastSum::choose(1e-2, 1000, hasWall));
        EXPECT_FALSE(FastSum::choose(1e-7, 1000000, hasWall));
        EXPECT_FALSE(FastSum::choose(0, 1000000, hasWall));
        EXPECT_EQ(FastSum::choose(5e-3, 1000000, hasWall), FastSum::choose(1e-3, 1000000, hasWall));
        EXPECT_TRUE(FastSum::choose(1e-6, 100000, hasWall));
        int order = 0;
        for (double error : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6}) {
            EXPECT_GT(FastSum::choose(error, 1000000, hasWall)->order, order);
            order = FastSum::choose(error, 1000000, hasWall)->order;
        }
    }
}

TEST(FastSum, NeitherThreadsNorWidthOfPacksShow) {
    for (bool hasWall : {false, true}) {
        const Scene scene = cloud(700, Mixed, false, hasWall, allOrFew(30, 20));
        const MatrixXd forces = forcesFor(scene);
        for (int floats : {0, 1, 2}) {
            const FastSum::Accuracy accuracy = {5, 0.7, 20, floats};
            const MatrixXd alone = fast(scene, forces, accuracy);
            for (int threads : {2, 3, 4}) {
                ThreadPool pool(threads);
                const MatrixXd together = fast(
                    scene, forces, accuracy, [&](int count, const function<void(int, int)>& task) {
                        pool.execute([&](ThreadPool&, int thread) {
                            task(count * thread / threads, count * (thread + 1) / threads);
                        });
                        pool.waitForThreads();
                    });
                EXPECT_TRUE((together.array() == alone.array()).all()) << threads;
            }
            // A product with several columns is the product column by column.
            for (int c = 0; c < forces.cols(); c++)
                EXPECT_LT((fast(scene, forces.col(c), accuracy) - alone.col(c)).norm(),
                          (floats > 0 ? 1e-6 : 1e-14) * alone.col(c).norm());
        }
        const FastSum::Accuracy accuracy = {5, 0.7, 20, 0};
        const MatrixXd best = fast(scene, forces, accuracy);
        for (int64_t target : {HWY_AVX3, HWY_AVX2, HWY_SSE4}) {
            hwy::SetSupportedTargetsForTest(0);
            if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
            hwy::SetSupportedTargetsForTest(target);
            hwy::GetChosenTarget().Update(target);
            const MatrixXd here = fast(scene, forces, accuracy);
            if (target == HWY_SSE4)
                EXPECT_LT((here - best).norm(), 1e-13 * best.norm());
            else
                EXPECT_TRUE((here.array() == best.array()).all()) << hwy::TargetName(target);
        }
        hwy::SetSupportedTargetsForTest(0);
        hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    }
}

// An earlier placement and its matrices have no influence.
TEST(FastSum, ForgetsEarlierPlacements) {
    for (bool hasWall : {false, true}) {
        const Scene scene = cloud(800, Spheres, false, hasWall, 25),
                    other = cloud(800, Spheres, false, hasWall, 40, 70);
        const MatrixXd forces = forcesFor(scene);
        const FastSum::Accuracy accuracy = {6, 0.7, 10, 0};
        FastSum sum(scene.particles, hasWall, accuracy, {});
        MatrixXd velocities;
        for (const Scene& where : {scene, other, scene}) {
            sum.moveTo(where.positions, vector<double>(800, 1.0));
            sum.apply(forces, 1 / (8 * M_PI * 0.7), velocities);
        }
        EXPECT_TRUE((velocities.array() == fast(scene, forces, accuracy).array()).all());
        EXPECT_GT(sum.getMemory(), 1000u);
    }
}

TEST(FastSum, HardPlaces) {
    const FastSum::Accuracy accuracy = {8, 0.6, 10, 0};
    Scene scene = cloud(300, Spheres, true, false, 10);
    const auto compare = [&](double tolerance) {
        const MatrixXd forces = forcesFor(scene), exact = exactly(scene, forces);
        EXPECT_LT((fast(scene, forces, accuracy) - exact).norm(), tolerance * exact.norm());
    };
    for (Vec3& r : scene.positions) r = Vec3(1, 2, 3);  // all at one place
    compare(1e-14);
    for (int i = 0; i < 300; i++)
        scene.positions[i] = i % 2 ? Vec3(1e9, 0, 0) : Vec3(1e-3 * i, 0, 0);
    compare(1e-4);
    scene = cloud(allOrFew(2000, 500), Mixed, false, false, allOrFew(60, 40));
    scene.particles.radii[17] = 25;  // one sphere contains many others
    compare(1e-4);
    const Scene alone = cloud(1, Spheres, true, true, 5);
    const MatrixXd forces = forcesFor(alone);
    EXPECT_LT((fast(alone, forces, accuracy) - exactly(alone, forces)).norm(), 1e-15);
    const MatrixXd none = MatrixXd::Zero(scene.particles.numRows, 1);
    EXPECT_EQ(fast(scene, none, accuracy).cwiseAbs().maxCoeff(), 0);
}

// A model uses the fast sum where it is accurate enough, and exact or rough products elsewhere.
TEST(FastSum, OfAModelAtAPlace) {
    const double error = 1e-2;
    for (bool hasWall : {false, true}) {
        const int n = fewestAt(error, hasWall);
        const Scene scene = cloud(n, Blobs, true, hasWall, 70),
                    moved = cloud(n, Blobs, true, hasWall, 80);
        const MatrixXd forces = forcesFor(scene).leftCols(1);
        const CpuRotnePragerYamakawa model = scene.model(), without = scene.model(false);
        EXPECT_TRUE(model.hasFastProducts(error));
        EXPECT_EQ(model.describeFastProducts(error), "by multipoles of order 4");
        EXPECT_FALSE(model.hasFastProducts(1e-9));
        EXPECT_FALSE(without.hasFastProducts(error));
        EXPECT_FALSE(cloud(100, Blobs, true, hasWall, 10).model().hasFastProducts(error));
        auto at = model.at({moved.positions});
        MatrixXd exact, found, rough;
        at->multiply(forces, found, {error});
        model.place(at, {scene.positions});
        at->multiply(forces, exact);
        at->multiply(forces, found, {error});
        EXPECT_LT((found - exact).norm(), error * exact.norm());
        EXPECT_GT((found - exact).norm(), 1e-5 * exact.norm());
        at->multiply(forces, found, {0});
        EXPECT_TRUE((found.array() == exact.array()).all());
        without.at({scene.positions})->multiply(forces, found, {error});
        at->multiply(forces, rough, {Accuracy::errorOfSinglePrecision});
        EXPECT_TRUE((found.array() == rough.array()).all());
        vector<Vec3> broken = scene.positions;
        broken[7][0] = NAN;
        if (!hasWall) {
            model.at({broken})->multiply(forces, found, {error});
            EXPECT_FALSE(found.allFinite());
        }
    }
}

// Products for differences keep the cubes of the accepted placement; others do not.
TEST(FastSum, DifferencesOfAModel) {
    const double error = 1e-2;
    for (bool hasWall : {false, true}) {
        if (isInstrumented() && !hasWall) continue;  // a wall has all that is there without
        const Scene scene = cloud(fewestAt(error, hasWall), Blobs, true, hasWall, 80);
        const MatrixXd forces = forcesFor(scene).leftCols(1);
        const CpuRotnePragerYamakawa model = scene.model();
        EXPECT_TRUE(model.getTraits().isAnchored);
        EXPECT_FALSE(cloud(100, Blobs, true, hasWall, 10).model().getTraits().isAnchored);
        mt19937 random(4);
        normal_distribution<double> g;
        vector<Vec3> ends[2] = {scene.positions, scene.positions};
        for (size_t i = 0; i < scene.positions.size(); i++)
            for (int k = 0; k < 3; k++) {
                const double by = 1e-6 * g(random);
                ends[0][i][k] -= by;
                ends[1][i][k] += by;
            }
        MatrixXd exact[2], smooth[2], other[2], forDifference;
        auto at = model.at({scene.positions});
        at->multiply(forces, forDifference, {error, Accuracy::Difference});
        for (int end : {0, 1}) {
            model.placeNear(at, {ends[end]});
            at->multiply(forces, exact[end]);
            at->multiply(forces, smooth[end], {error, Accuracy::Difference});
            at->multiply(forces, other[end], {error});
        }
        const MatrixXd difference = exact[1] - exact[0];
        EXPECT_LT((smooth[1] - smooth[0] - difference).norm(), error * difference.norm());
        EXPECT_GT((smooth[1] - smooth[0] - difference).norm(), 1e-6 * error * difference.norm());
        EXPECT_GT((other[1] - other[0] - difference).norm(), error * difference.norm());
        // The placement in between is on the same smooth function.
        const MatrixXd half = smooth[1] - forDifference - 0.5 * difference;
        EXPECT_LT(half.norm(), error * difference.norm());
        // An object that is taken to the placement first gives the same products.
        unique_ptr<MobilityAt> another = model.at({ends[0]});
        model.place(another, {scene.positions});
        model.placeNear(another, {ends[1]});
        MatrixXd again;
        another->multiply(forces, again, {error, Accuracy::Difference});
        EXPECT_TRUE((again.array() == smooth[1].array()).all());
        // Without multipoles products are exact.
        const CpuRotnePragerYamakawa without = scene.model(false);
        EXPECT_FALSE(without.getTraits().isAnchored);
        without.at({ends[1]})->multiply(forces, again, {error, Accuracy::Difference});
        EXPECT_TRUE((again.array() == exact[1].array()).all());
    }
}

// Particles that reach through a wall are lifted, and their forces and velocities are damped.
TEST(FastSum, ThroughAWall) {
    Scene scene = cloud(6000, Mixed, true, true, 60);
    for (Vec3& r : scene.positions) r[2] = max(r[2] - 1.3, 0.01);
    const CpuRotnePragerYamakawa model(scene.particles, 0.7, {}, NoSlipPlane(0, true));
    const MatrixXd forces = forcesFor(scene);
    MatrixXd exact, found;
    const auto at = model.at({scene.positions});
    at->multiply(forces, exact);
    at->multiply(forces, found, {1e-2});
    EXPECT_LT((found - exact).col(0).norm(), 1e-2 * exact.col(0).norm());
    EXPECT_GT((found - exact).col(0).norm(), 1e-6 * exact.col(0).norm());
}

// Lengths in another unit: forces stay, torques and velocities scale. Fifth powers of these lengths
// leave the range of floats.
TEST(FastSum, TheUnitOfLengthDoesNotShow) {
    for (bool hasWall : {false, true})
        for (int floats : {0, 2}) {
            const FastSum::Accuracy accuracy = {4, 0.8, 40, floats};
            const Scene scene = cloud(allOrFew(2000, 500), Mixed, false, hasWall, 60);
            const MatrixXd forces = forcesFor(scene), velocities = fast(scene, forces, accuracy);
            EXPECT_LT((velocities - exactly(scene, forces)).norm(), 1e-2 * velocities.norm());
            for (int power : {-40, -27, 30, 50}) {
                const double unit = ldexp(1.0, power);
                Scene scaled = scene;
                for (Vec3& r : scaled.positions) r *= unit;
                for (double& a : scaled.particles.radii) a *= unit;
                MatrixXd scaledForces = forces, expected = velocities / unit;
                for (int i = 0; i < scene.particles.size(); i++)
                    if (scene.particles.hasTorque[i]) {
                        const int row = scene.particles.firstRow[i] + 3;
                        scaledForces.middleRows<3>(row) *= unit;
                        expected.middleRows<3>(row) /= unit;
                    }
                const MatrixXd found = fast(scaled, scaledForces, accuracy);
                EXPECT_EQ((found - expected).cwiseAbs().maxCoeff(), 0)
                    << (hasWall ? "wall, " : "") << "floats " << floats << ", 2^" << power;
            }
        }
}
