// The Rotne-Prager-Yamakawa mobility with SIMD and threads against the scalar one.

#include <openmm/internal/ThreadPool.h>
#include "host/SimdTargets.h"  // must precede Highway

#include <atomic>

#include "TestSupport.h"
#include "hwy/targets.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;

namespace {

enum Kind { Spheres, Blobs, Mixed };

/** Wall: near contact for the lowest. Crossing: through which a good part of the particles reach. */
enum Bounds { Unbounded, Wall, Crossing };

struct Scene {
    HydrodynamicParticles particles;
    vector<Vec3> positions;
    optional<NoSlipPlane> wall;

    unique_ptr<MobilityModel> reference() const {
        if (wall) return unique_ptr<MobilityModel>(new RotnePragerYamakawaWall(particles, 0.7, *wall));
        return unique_ptr<MobilityModel>(new RotnePragerYamakawa(particles, 0.7));
    }
};
/** Dense: many overlaps, some particles inside others. Sparse: packs of all sorts. */
Scene randomScene(int n, Kind kind, bool equalRadii, double size, Bounds bounds = Unbounded) {
    mt19937 random(n + 1000 * kind);
    uniform_real_distribution<double> u(0, 1);
    Scene scene;
    for (int i = 0; i < n; i++) {
        scene.particles.add(equalRadii ? 0.8 : 0.2 + u(random), kind == Spheres || (kind == Mixed && u(random) < 0.5),
                            i, -1);
        scene.positions.push_back(size * Vec3(u(random), u(random), u(random)));
    }
    if (bounds == Wall) scene.wall.emplace(-1.2, false);
    if (bounds == Crossing) scene.wall.emplace(-0.01, true);
    return scene;
}

struct Results {
    MatrixXd dense, velocities, rough;
};
Results results(const Scene& scene, const MatrixXd& forces, CpuRotnePragerYamakawa::ForRanges forRanges = {}) {
    CpuRotnePragerYamakawa M(scene.particles, 0.7, forRanges, scene.wall);
    const auto at = M.at({scene.positions});
    Results r;
    at->dense(r.dense);
    at->apply(forces, r.velocities);
    at->applyRoughly(forces, r.rough);
    return r;
}

/** Run a test with every instruction set that was compiled and that this machine has. */
template <class Test>
void onEveryInstructionSet(Test test) {
    for (int64_t target : {HWY_AVX3, HWY_AVX2, HWY_SSE4}) {
        hwy::SetSupportedTargetsForTest(0);
        if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
        hwy::SetSupportedTargetsForTest(target);
        hwy::GetChosenTarget().Update(target);
        SCOPED_TRACE(hwy::TargetName(target));
        test(target);
    }
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace

TEST(CpuRotnePragerYamakawa, AgreesWithTheScalarOne) {
    onEveryInstructionSet([](int64_t) {
        for (int n : {1, 2, 3, 7, 8, 9, 17, 100})
            for (Kind kind : {Spheres, Blobs, Mixed})
                for (int variant = 0; variant < 12; variant++) {
                    const Scene scene =
                        randomScene(n, kind, variant % 2, variant / 2 % 2 ? 10 : 1, Bounds(variant / 4));
                    const auto model = scene.reference();
                    const auto reference = model->at({scene.positions});
                    MatrixXd dense;
                    reference->dense(dense);
                    const double scale = dense.cwiseAbs().maxCoeff();
                    for (int columns : {1, 2, 5}) {
                        const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, columns);
                        const Results r = results(scene, forces);
                        ASSERT_LT((r.dense - dense).cwiseAbs().maxCoeff(), 1e-13 * scale) << n << " " << kind;
                        ASSERT_EQ((r.dense - r.dense.transpose()).cwiseAbs().maxCoeff(), 0);
                        MatrixXd velocities;
                        reference->apply(forces, velocities);
                        ASSERT_LT((r.velocities - velocities).cwiseAbs().maxCoeff(), 1e-12 * scale) << n << " " << kind;
                    }
                }
    });
}

namespace {

void expectNeitherThreadsNorWidthOfPacks(Bounds bounds) {
    // Enough pairs to wake threads.
    const Scene scene = randomScene(401, Mixed, false, 20, bounds);
    const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, 3);
    const Results alone = results(scene, forces);
    for (int threads : {2, 3}) {
        ThreadPool pool(threads);
        atomic<int> ranges(0);
        const Results r = results(scene, forces, [&](int count, const function<void(int, int)>& task) {
            pool.execute([&](ThreadPool&, int thread) {
                ranges++;
                task(count * thread / threads, count * (thread + 1) / threads);
            });
            pool.waitForThreads();
        });
        EXPECT_EQ(ranges, 5 * threads);  // the matrix, two columns, one column, twice
        EXPECT_EQ((r.dense.array() != alone.dense.array()).count(), 0);
        EXPECT_EQ((r.velocities.array() != alone.velocities.array()).count(), 0);
        EXPECT_EQ((r.rough.array() != alone.rough.array()).count(), 0);
    }
    onEveryInstructionSet([&](int64_t target) {
        if (target != HWY_AVX3 && target != HWY_AVX2) return;  // others round products before adding
        const Results r = results(scene, forces);
        EXPECT_EQ((r.velocities.array() != alone.velocities.array()).count(), 0);
    });
}

}  // namespace

TEST(CpuRotnePragerYamakawa, NeitherThreadsNorWidthOfPacksShow) {
    for (Bounds bounds : {Unbounded, Wall, Crossing}) expectNeitherThreadsNorWidthOfPacks(bounds);
}

TEST(CpuRotnePragerYamakawa, RoughProductsAreRightToSixDigits) {
    onEveryInstructionSet([](int64_t) {
        for (int n : {1, 9, 33, 100})
            for (Kind kind : {Spheres, Blobs, Mixed})
                for (int variant = 0; variant < 12; variant++) {
                    const Scene scene =
                        randomScene(n, kind, variant % 2, variant / 2 % 2 ? 10 : 1, Bounds(variant / 4));
                    const CpuRotnePragerYamakawa model(scene.particles, 0.7, {}, scene.wall);
                    const auto M = model.at({scene.positions});
                    MatrixXd dense, exact, rough;
                    M->dense(dense);
                    // From below, by the power method.
                    Eigen::VectorXd v = Eigen::VectorXd::Ones(dense.rows()).normalized();
                    for (int k = 0; k < 20; k++) v = (dense * v).normalized();
                    const double norm = (dense * v).norm();
                    for (double unit : {1.0, 1e-50, 1e50}) {
                        const MatrixXd forces = unit * MatrixXd::Random(scene.particles.numRows, 3);
                        M->apply(forces, exact);
                        M->applyRoughly(forces, rough);
                        for (int c = 0; c < forces.cols(); c++)
                            ASSERT_LT((rough - exact).col(c).norm(),
                                      MobilityAt::roughError * norm * forces.col(c).norm())
                                << n << " " << kind << " " << variant;
                        ASSERT_GT((rough - exact).norm(), 0);  // else this tests nothing
                    }
                }
    });
}

TEST(CpuRotnePragerYamakawa, RoughProductsAreExactForRadiiBeyondFloats) {
    for (double unit : {1e-6, 1e6}) {
        Scene scene = randomScene(20, Mixed, false, 10);
        for (auto& a : scene.particles.radii) a *= unit;
        for (auto& r : scene.positions) r *= unit;
        const CpuRotnePragerYamakawa model(scene.particles, 0.7);
        const auto M = model.at({scene.positions});
        const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, 2);
        MatrixXd exact, rough;
        M->apply(forces, exact);
        M->applyRoughly(forces, rough);
        EXPECT_EQ((exact.array() != rough.array()).count(), 0);
    }
}

TEST(CpuRotnePragerYamakawa, ObjectsToTheSamePositions) {
    for (Bounds bounds : {Wall, Crossing}) {
        Scene scene = randomScene(9, Mixed, true, 3, bounds);
        CpuRotnePragerYamakawa M(scene.particles, 0.7, {}, scene.wall);
        EXPECT_TRUE(M.mayObject());
        M.at({scene.positions});
        scene.positions[5][2] = bounds == Wall ? -0.5 : -0.02;
        const string problem = scene.reference()->objection({scene.positions});
        EXPECT_NE(problem.find("particle 5 "), string::npos);
        EXPECT_EQ(M.objection({scene.positions}), problem);
        expectError([&] { M.at({scene.positions}); }, {problem});
    }
    EXPECT_FALSE(CpuRotnePragerYamakawa(HydrodynamicParticles(), 1).mayObject());
    EXPECT_TRUE(CpuRotnePragerYamakawa(HydrodynamicParticles(), 1).acceptsNearby({}));
}

TEST(CpuRotnePragerYamakawa, ReachesAsFarBeyondContact) {
    for (Bounds bounds : {Wall, Crossing}) {
        Scene scene = randomScene(9, Mixed, false, 3, bounds);
        CpuRotnePragerYamakawa M(scene.particles, 0.7, {}, scene.wall);
        const auto reference = scene.reference();
        // At most a hundredth of a radius below contact; with crossing allowed, wherever there is a mobility.
        const double a = scene.particles.radii[5], height = scene.wall->getHeight();
        for (double z : {0.98 * a, 0.995 * a, -0.01 * a}) {
            scene.positions[5][2] = height + z;
            const bool accepted = bounds == Wall ? z > 0.99 * a : z > 0;
            EXPECT_EQ(M.acceptsNearby({scene.positions}), accepted) << z;
            EXPECT_EQ(reference->acceptsNearby({scene.positions}), accepted) << z;
        }
        scene.positions[5][2] = height + (bounds == Wall ? 1 : 0.5) * a - 1e-6;
        MatrixXd dense, expected;
        const auto nearby = M.near({scene.positions});
        nearby->dense(dense);
        reference->near({scene.positions})->dense(expected);
        EXPECT_LT((dense - expected).cwiseAbs().maxCoeff(), 1e-13 * expected.maxCoeff());
        // Another place at the same time, as ever.
        const MatrixXd before = dense;
        scene.positions[5][2] += 1e-3;
        M.at({scene.positions})->dense(dense);
        reference->at({scene.positions})->dense(expected);
        EXPECT_LT((dense - expected).cwiseAbs().maxCoeff(), 1e-13 * expected.maxCoeff());
        EXPECT_GT((dense - before).norm(), 0);
        nearby->dense(dense);
        EXPECT_EQ((dense - before).norm(), 0);
    }
}

TEST(CpuRotnePragerYamakawa, ColumnsDoNotShowInEachOther) {
    const Scene scene = randomScene(30, Mixed, false, 5);
    const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, 3);
    const MatrixXd together = results(scene, forces).velocities;
    for (int c = 0; c < 3; c++)
        EXPECT_EQ((results(scene, forces.col(c)).velocities - together.col(c)).cwiseAbs().maxCoeff(), 0);
}

TEST(CpuRotnePragerYamakawa, ParticlesAtOnePlace) {
    Scene scene;
    for (int i = 0; i < 3; i++) {
        scene.particles.add(i < 2 ? 1 : 0.5, true, i, -1);
        scene.positions.push_back(Vec3(1, 2, 3));
    }
    const MatrixXd M = results(scene, MatrixXd::Identity(18, 18)).dense;
    ASSERT_TRUE(M.allFinite());
    for (int i = 0; i < 18; i += 6)
        for (int j = 0; j < 12; j += 6) EXPECT_NEAR(M(i, j), 1 / (6 * M_PI * 0.7), 1e-15);
}

TEST(CpuRotnePragerYamakawa, HasNoDivergenceWhereTheScalarOneHasNone) {
    for (Bounds bounds : {Unbounded, Wall, Crossing}) {
        const Scene scene = randomScene(5, Mixed, false, 3, bounds);
        const CpuRotnePragerYamakawa M(scene.particles, 0.7, {}, scene.wall);
        EXPECT_EQ(M.isDivergenceFree(), scene.reference()->isDivergenceFree());
        EXPECT_EQ(M.isDivergenceFree(), bounds == Unbounded);
    }
}
