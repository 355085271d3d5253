// The Rotne-Prager-Yamakawa mobility with SIMD and threads agrees with the scalar implementation.

#include <openmm/internal/ThreadPool.h>
#include "simd/SimdTargets.h"  // must precede Highway

#include <atomic>
#include <bitset>

#include "TestSupport.h"
#include "hwy/targets.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/PairSums.h"
#include "mobility/models/rotneprager/PairTournament.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;

namespace {

enum Kind { Spheres, Blobs, Mixed };

/** With Wall the lowest particles are near contact. With Crossing many reach through the wall. */
enum Bounds { Unbounded, Wall, Crossing };

struct Scene {
    HydrodynamicParticles particles;
    vector<Vec3> positions;
    optional<NoSlipPlane> wall;

    unique_ptr<MobilityModel> reference() const {
        if (wall) return make_unique<RotnePragerYamakawaWall>(particles, 0.7, *wall);
        return make_unique<RotnePragerYamakawa>(particles, 0.7);
    }
};
/** In a small cube many particles overlap, and some are inside others. In a large cube packs hold
 * pairs of all kinds. */
Scene randomScene(int n, Kind kind, bool equalRadii, double size, Bounds bounds = Unbounded) {
    mt19937 random(n + 1000 * kind);
    uniform_real_distribution<double> u(0, 1);
    Scene scene;
    for (int i = 0; i < n; i++) {
        scene.particles.add(equalRadii ? 0.8 : 0.2 + u(random),
                            kind == Spheres || (kind == Mixed && u(random) < 0.5), i, -1);
        scene.positions.push_back(size * Vec3(u(random), u(random), u(random)));
    }
    if (bounds == Wall) scene.wall.emplace(-1.2, false);
    if (bounds == Crossing) scene.wall.emplace(-0.01, true);
    return scene;
}

struct Results {
    MatrixXd dense, velocities, rough;
};
Results results(const Scene& scene, const MatrixXd& forces,
                CpuRotnePragerYamakawa::ForRanges forRanges = {}) {
    CpuRotnePragerYamakawa M(scene.particles, 0.7, forRanges, scene.wall);
    const auto at = M.at({scene.positions});
    Results r;
    at->dense(r.dense);
    at->multiply(forces, r.velocities);
    at->multiply(forces, r.rough, {Accuracy::errorOfSinglePrecision});
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

// Each instruction set takes minutes to compile. Newer versions of Highway have more sets than the
// library uses.
TEST(SimdTargets, AreFourAtMost) { EXPECT_LE(bitset<64>(HWY_TARGETS).count(), 4u); }

TEST(CpuRotnePragerYamakawa, AgreesWithTheScalarOne) {
    onEveryInstructionSet([](int64_t) {
        for (int n : {1, 2, 3, 7, 8, 9, 17, 100})
            for (Kind kind : {Spheres, Blobs, Mixed})
                for (int variant = 0; variant < 12; variant++) {
                    const Scene scene = randomScene(n, kind, variant % 2, variant / 2 % 2 ? 10 : 1,
                                                    Bounds(variant / 4));
                    const auto model = scene.reference();
                    const auto reference = model->at({scene.positions});
                    MatrixXd dense;
                    reference->dense(dense);
                    const double scale = dense.cwiseAbs().maxCoeff();
                    for (int columns : {1, 2, 5}) {
                        const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, columns);
                        const Results r = results(scene, forces);
                        ASSERT_LT((r.dense - dense).cwiseAbs().maxCoeff(), 1e-13 * scale)
                            << n << " " << kind;
                        ASSERT_EQ((r.dense - r.dense.transpose()).cwiseAbs().maxCoeff(), 0);
                        MatrixXd velocities;
                        reference->multiply(forces, velocities);
                        ASSERT_LT((r.velocities - velocities).cwiseAbs().maxCoeff(), 1e-12 * scale)
                            << n << " " << kind;
                    }
                }
    });
}

// The sums work on chunks of 128 particles of a kind, on blocks of 16 or 32 of these particles, and
// on packs of up to 16.
TEST(CpuRotnePragerYamakawa, AgreesWithTheScalarOneAroundBordersOfChunks) {
    onEveryInstructionSet([](int64_t) {
        for (int n : {31, 32, 33, 127, 128, 129, 257})
            for (Kind kind : {Spheres, Blobs, Mixed})
                for (Bounds bounds : {Unbounded, Wall, Crossing})
                    for (double size : {2.0, 15.0}) {  // many overlaps across all borders; few
                        const Scene scene = randomScene(n, kind, false, size, bounds);
                        const auto model = scene.reference();
                        const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, 3);
                        MatrixXd dense;
                        model->at({scene.positions})->dense(dense);
                        const double scale = dense.cwiseAbs().rowwise().sum().maxCoeff();
                        const MatrixXd velocities = results(scene, forces).velocities;
                        ASSERT_LT((velocities - dense * forces).cwiseAbs().maxCoeff(),
                                  1e-14 * scale)
                            << n << " " << kind << " " << bounds;
                    }
    });
}

TEST(CpuRotnePragerYamakawa, ProductsAreSymmetric) {
    onEveryInstructionSet([](int64_t) {
        for (Bounds bounds : {Unbounded, Wall, Crossing})
            for (double size : {2.0, 10.0}) {
                const Scene scene = randomScene(70, Mixed, false, size, bounds);
                const int rows = scene.particles.numRows;
                const Results r = results(scene, MatrixXd::Identity(rows, rows));
                const double scale = r.velocities.cwiseAbs().maxCoeff();
                EXPECT_LT((r.velocities - r.velocities.transpose()).cwiseAbs().maxCoeff(),
                          1e-15 * scale);
                EXPECT_LT((r.rough - r.rough.transpose()).cwiseAbs().maxCoeff(), 1e-6 * scale);
            }
    });
}

namespace {

void expectNeitherThreadsNorWidthOfPacks(const Scene& scene) {
    const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, 3);
    const Results alone = results(scene, forces);
    const auto expectTheSame = [&](const Results& r) {
        EXPECT_EQ((r.dense.array() != alone.dense.array()).count(), 0);
        EXPECT_EQ((r.velocities.array() != alone.velocities.array()).count(), 0);
        EXPECT_EQ((r.rough.array() != alone.rough.array()).count(), 0);
    };
    for (int threads : {2, 3, 4}) {
        ThreadPool pool(threads);
        atomic<int> ranges(0);
        expectTheSame(results(scene, forces, [&](int count, const function<void(int, int)>& task) {
            pool.execute([&](ThreadPool&, int thread) {
                ranges++;
                task(count * thread / threads, count * (thread + 1) / threads);
            });
            pool.waitForThreads();
        }));
        EXPECT_EQ(ranges, 5 * threads);  // the matrix; twice two columns and one column
    }
    // A caller need not compute the ranges at the same time.
    expectTheSame(results(scene, forces, [&](int count, const function<void(int, int)>& task) {
        task(0, count / 2);
        task(count / 2, count);
    }));
    onEveryInstructionSet([&](int64_t target) {
        if (target != HWY_AVX3 && target != HWY_AVX2)
            return;  // other instruction sets round products before adding
        const Results r = results(scene, forces);
        EXPECT_EQ((r.velocities.array() != alone.velocities.array()).count(), 0);
    });
}

}  // namespace

TEST(CpuRotnePragerYamakawa, NeitherThreadsNorWidthOfPacksShow) {
    // There are enough pairs to wake the threads, with some overlaps in the first scenes and many
    // in others.
    for (Bounds bounds : {Unbounded, Wall, Crossing})
        expectNeitherThreadsNorWidthOfPacks(randomScene(401, Mixed, false, 20, bounds));
    expectNeitherThreadsNorWidthOfPacks(randomScene(383, Blobs, true, 20));
    expectNeitherThreadsNorWidthOfPacks(randomScene(385, Spheres, true, 5));
}

TEST(CpuRotnePragerYamakawa, RoughProductsAreRightToSixDigits) {
    onEveryInstructionSet([](int64_t) {
        for (int n : {1, 9, 33, 100})
            for (Kind kind : {Spheres, Blobs, Mixed})
                for (int variant = 0; variant < 12; variant++) {
                    const Scene scene = randomScene(n, kind, variant % 2, variant / 2 % 2 ? 10 : 1,
                                                    Bounds(variant / 4));
                    const CpuRotnePragerYamakawa model(scene.particles, 0.7, {}, scene.wall);
                    const auto M = model.at({scene.positions});
                    MatrixXd dense, exact, rough;
                    M->dense(dense);
                    // The power method gives a lower bound of the norm of M.
                    Eigen::VectorXd v = Eigen::VectorXd::Ones(dense.rows()).normalized();
                    for (int k = 0; k < 20; k++) v = (dense * v).normalized();
                    const double norm = (dense * v).norm();
                    for (double unit : {1.0, 1e-50, 1e50}) {
                        const MatrixXd forces = unit * MatrixXd::Random(scene.particles.numRows, 3);
                        M->multiply(forces, exact);
                        M->multiply(forces, rough, {Accuracy::errorOfSinglePrecision});
                        for (int c = 0; c < forces.cols(); c++)
                            ASSERT_LT(
                                (rough - exact).col(c).norm(),
                                Accuracy::errorOfSinglePrecision * norm * forces.col(c).norm())
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
        M->multiply(forces, exact);
        M->multiply(forces, rough, {Accuracy::errorOfSinglePrecision});
        EXPECT_EQ((exact.array() != rough.array()).count(), 0);
    }
}

TEST(CpuRotnePragerYamakawa, RoughProductsAreExactForPlacesBeyondFloats) {
    Scene scene = randomScene(20, Mixed, false, 10);
    const CpuRotnePragerYamakawa model(scene.particles, 0.7);
    const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, 2);
    MatrixXd exact, rough;
    for (double x : {1e10, 1e8, -1e10}) {
        scene.positions[7][0] = x;
        const auto M = model.at({scene.positions});
        M->multiply(forces, exact);
        M->multiply(forces, rough, {Accuracy::errorOfSinglePrecision});
        EXPECT_EQ((exact.array() != rough.array()).count() == 0, abs(x) > 1e9) << x;
    }
}

TEST(PairTournament, EveryPairOnceInTheSameOrderOnAnyThreads) {
    for (int chunks : {0, 1, 2, 3, 4, 5, 8, 9, 30}) {
        PairTournament tournament(chunks);
        for (int threads : {1, 2, 3, 4}) {
            // These are the partners of each chunk, in order. Only the turns of the tournament
            // protect these lists against concurrent access.
            vector<vector<int>> partners(chunks);
            atomic<int> computed(0);
            tournament.begin();
            ThreadPool pool(threads);
            pool.execute([&](ThreadPool&, int) {
                int first = -1, second = -1;
                tournament.play(
                    [&](int a, int b) {
                        computed++;
                        first = a;
                        second = b;
                    },
                    [&](int chunk, bool isSecond) {
                        EXPECT_EQ(chunk, isSecond ? second : first);
                        partners[chunk].push_back(isSecond ? first : second);
                    });
            });
            pool.waitForThreads();
            EXPECT_EQ(computed, tournament.getNumPairs());
            for (int a = 0; a < chunks; a++) {
                ASSERT_EQ(static_cast<int>(partners[a].size()), chunks);
                for (int round = 0; round < chunks; round++)
                    EXPECT_EQ((a + partners[a][round]) % chunks, round);
            }
        }
    }
}

/** Other sums may choose their own ranges, with either kind of particle first. */
TEST(PairSums, TwoRangesBothWays) {
    for (Bounds bounds : {Unbounded, Wall})
        for (int kinds = 0; kinds < 4; kinds++) {
            // There are 20 particles in slots 0 ... 31, and 13 in slots 32 ... 47.
            const bool torques[2] = {kinds % 2 == 1, kinds / 2 == 1};
            const int counts[2] = {20, 13}, starts[2] = {0, 32}, slots = 48;
            const Scene all = randomScene(33, Spheres, false, 4, bounds);
            Scene scene;
            if (all.wall) scene.wall.emplace(*all.wall);
            vector<double> x(slots, PairSumArrays::farAway), y = x, z = x, radius(slots, 1.0),
                                                             loads(6 * slots), sums(6 * slots);
            MatrixXd forces = MatrixXd::Random(6 * 33, 1);
            for (int i = 0, row = 0; i < 33; i++) {
                const int range = i < counts[0] ? 0 : 1,
                          slot = starts[range] + i - (range ? counts[0] : 0);
                scene.particles.add(all.particles.radii[i], torques[range], i, -1);
                scene.positions.push_back(all.positions[i]);
                x[slot] = all.positions[i][0];
                y[slot] = all.positions[i][1];
                z[slot] = all.positions[i][2] - (all.wall ? all.wall->getHeight() : 0);
                radius[slot] = all.particles.radii[i];
                for (int k = 0; k < (torques[range] ? 6 : 3); k++)
                    loads[k * slots + slot] = forces(row++);
            }
            forces.conservativeResize(scene.particles.numRows, 1);
            PairSumArrays arrays = {};
            arrays.x = x.data();
            arrays.y = y.data();
            arrays.z = z.data();
            arrays.radius = radius.data();
            arrays.hasWall = scene.wall.has_value();
            arrays.columns = 1;
            arrays.stride = slots;
            arrays.loads = loads.data();
            const SlotRange ranges[2] = {{starts[0], starts[0] + counts[0], torques[0]},
                                         {starts[1], starts[1] + counts[1], torques[1]}};
            addPairs(arrays, ranges[0], ranges[1], sums.data(), sums.data() + starts[1], slots);
            for (int r = 0; r < 2; r++)
                addPairs(arrays, ranges[r], ranges[r], sums.data() + starts[r],
                         sums.data() + starts[r], slots);
            MatrixXd dense;
            scene.reference()->at({scene.positions})->dense(dense);
            const MatrixXd expected = 8 * M_PI * 0.7 * dense * forces;
            for (int i = 0, row = 0; i < 33; i++) {
                const int range = i < counts[0] ? 0 : 1,
                          slot = starts[range] + i - (range ? counts[0] : 0);
                for (int k = 0; k < (torques[range] ? 6 : 3); k++)
                    EXPECT_NEAR(sums[k * slots + slot], expected(row++), 1e-13 * expected.norm());
            }
        }
}

TEST(CpuRotnePragerYamakawa, ObjectsToTheSamePositions) {
    for (Bounds bounds : {Wall, Crossing}) {
        Scene scene = randomScene(9, Mixed, true, 3, bounds);
        CpuRotnePragerYamakawa M(scene.particles, 0.7, {}, scene.wall);
        EXPECT_TRUE(M.getTraits().mayObject);
        M.at({scene.positions});
        scene.positions[5][2] = bounds == Wall ? -0.5 : -0.02;
        const string problem = scene.reference()->objection({scene.positions});
        EXPECT_NE(problem.find("particle 5 "), string::npos);
        EXPECT_EQ(M.objection({scene.positions}), problem);
        expectError([&] { M.at({scene.positions}); }, {problem});
    }
    EXPECT_FALSE(CpuRotnePragerYamakawa(HydrodynamicParticles(), 1).getTraits().mayObject);
    EXPECT_TRUE(CpuRotnePragerYamakawa(HydrodynamicParticles(), 1).acceptsNearby({}));
}

TEST(CpuRotnePragerYamakawa, ReachesAsFarBeyondContact) {
    for (Bounds bounds : {Wall, Crossing}) {
        Scene scene = randomScene(9, Mixed, false, 3, bounds);
        CpuRotnePragerYamakawa M(scene.particles, 0.7, {}, scene.wall);
        const auto reference = scene.reference();
        // A particle is accepted down to a hundredth of a radius below contact or, with crossing
        // allowed, wherever there is a mobility.
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
        // Another MobilityAt of the same model may exist at the same time.
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
        EXPECT_EQ(
            (results(scene, forces.col(c)).velocities - together.col(c)).cwiseAbs().maxCoeff(), 0);
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
        EXPECT_EQ(M.getTraits().isDivergenceFree, scene.reference()->getTraits().isDivergenceFree);
        EXPECT_EQ(M.getTraits().isDivergenceFree, bounds == Unbounded);
    }
}
