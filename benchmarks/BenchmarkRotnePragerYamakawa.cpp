// The cost of a product with the Rotne-Prager-Yamakawa mobility, for instruction sets, threads,
// columns and kinds of particles, in unbounded fluid and above a wall, and the cost of its matrix.
// Suspensions have volume fraction 0.1, on a lattice with random displacements.

#include <benchmark/benchmark.h>
#include <openmm/internal/ThreadPool.h>

#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <string>

#include "PlainPairs.h"
#include "hwy/targets.h"
#include "linearalgebra/Lanczos.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

using namespace RigidHIPlugin;
using OpenMM::ThreadPool;
using OpenMM::Vec3;

namespace {

enum Kind { Spheres, Blobs, TouchingBlobs, SpheresAtWall, BlobsAtWall };

struct Scene {
    HydrodynamicParticles particles;
    std::vector<Vec3> positions;
    std::optional<NoSlipPlane> wall;
    Scene(int n, Kind kind) {
        // Neighbouring blobs of multiblobs are two radii apart, so many packs contain touching
        // blobs.
        const double spacing = kind == TouchingBlobs ? 2 : std::cbrt(4 * M_PI / 3 / 0.1);
        const double shift = kind == TouchingBlobs ? 0 : 0.5 * (spacing - 2) / std::sqrt(3.0);
        const int edge = std::ceil(std::cbrt(n));
        std::mt19937 random(1);
        std::uniform_real_distribution<double> u(-shift, shift);
        for (int i = 0; i < n; i++) {
            particles.add(1, kind == Spheres || kind == SpheresAtWall, i, -1);
            const Vec3 node(i % edge, i / edge % edge, i / edge / edge);
            positions.push_back(spacing * node +
                                (shift > 0 ? Vec3(u(random), u(random), u(random)) : Vec3()));
        }
        if (kind == SpheresAtWall || kind == BlobsAtWall) wall.emplace(-1.01 - shift, false);
    }
    CpuRotnePragerYamakawa mobility(const CpuRotnePragerYamakawa::ForRanges& forRanges) const {
        return CpuRotnePragerYamakawa(particles, 1.0, forRanges, wall);
    }
};

/** Restrict Highway to this target and lower ones. */
const char* restrictTo(int64_t best) {
    int64_t allowed = 0;
    hwy::SetSupportedTargetsForTest(0);
    for (int64_t target : {HWY_AVX3, HWY_AVX2, HWY_SSE4}) {
        if (target == best) allowed = 0;
        allowed |= target;
    }
    if (best != 0) hwy::SetSupportedTargetsForTest(allowed & hwy::SupportedTargets());
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    return best == HWY_SSE4 ? "SSE4" : best == HWY_AVX2 ? "AVX2" : "best";
}

CpuRotnePragerYamakawa::ForRanges onThreads(ThreadPool& pool) {
    return [&pool](int count, const std::function<void(int, int)>& task) {
        const int parts = pool.getNumThreads();
        pool.execute([&](ThreadPool&, int thread) {
            task(static_cast<int>((long long)count * thread / parts),
                 static_cast<int>((long long)count * (thread + 1) / parts));
        });
        pool.waitForThreads();
    };
}

void finish(benchmark::State& state, int n) {
    const double pairs = static_cast<double>(n) * n * state.iterations();
    state.counters["pairs"] = benchmark::Counter(pairs, benchmark::Counter::kIsRate);
    state.counters["time_per_pair"] =
        benchmark::Counter(pairs, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void product(benchmark::State& state, Kind kind, int64_t target) {
    const int n = state.range(0), columns = state.range(1), threads = state.range(2);
    state.SetLabel(restrictTo(target));
    ThreadPool pool(threads);
    const Scene scene(n, kind);
    const CpuRotnePragerYamakawa model =
        scene.mobility(threads > 1 ? onThreads(pool) : CpuRotnePragerYamakawa::ForRanges());
    const auto M = model.at({scene.positions});
    const Eigen::MatrixXd forces = Eigen::MatrixXd::Random(scene.particles.numRows, columns);
    Eigen::MatrixXd velocities;
    for (auto _ : state) {
        M->multiply(forces, velocities);
        benchmark::DoNotOptimize(velocities.data());
        benchmark::ClobberMemory();
    }
    finish(state, n);
}
#define PRODUCT(kind, target)                                 \
    BENCHMARK_CAPTURE(product, kind##_##target, kind, target) \
        ->Unit(benchmark::kMillisecond)                       \
        ->UseRealTime()
const int64_t best = 0, AVX2 = HWY_AVX2, SSE4 = HWY_SSE4;
PRODUCT(Spheres, best)
    ->ArgNames({"n", "columns", "threads"})
    ->Args({10, 1, 1})
    ->Args({100, 1, 1})
    ->Args({1000, 1, 1})
    ->Args({1000, 2, 1})
    ->Args({1000, 2, 2})
    ->Args({1000, 4, 1})
    ->Args({10000, 1, 2})
    ->Args({10000, 2, 1})
    ->Args({10000, 2, 2});
PRODUCT(Blobs, best)
    ->ArgNames({"n", "columns", "threads"})
    ->Args({1000, 2, 1})
    ->Args({10000, 2, 2});
PRODUCT(TouchingBlobs, best)->ArgNames({"n", "columns", "threads"})->Args({1000, 2, 1});
PRODUCT(SpheresAtWall, best)
    ->ArgNames({"n", "columns", "threads"})
    ->Args({1000, 1, 1})
    ->Args({1000, 2, 1})
    ->Args({1000, 2, 2});
PRODUCT(BlobsAtWall, best)->ArgNames({"n", "columns", "threads"})->Args({1000, 2, 1});
PRODUCT(Spheres, AVX2)
    ->ArgNames({"n", "columns", "threads"})
    ->Args({1000, 2, 1})
    ->Args({10000, 2, 2});
PRODUCT(Spheres, SSE4)->ArgNames({"n", "columns", "threads"})->Args({1000, 2, 1});

/**
 * The yardstick of PlainPairs.h. Above a wall it uses the same scenes, but leaves out the own
 * mobility of a sphere.
 */
void plainProduct(benchmark::State& state, Kind kind, int64_t target) {
    const int n = state.range(0), columns = state.range(1), threads = state.range(2);
    state.SetLabel(restrictTo(target));
    ThreadPool pool(threads);
    const Scene scene(n, kind);
    PlainPairs pairs;
    for (const Vec3& r : scene.positions) {
        pairs.x.push_back(r[0]);
        pairs.y.push_back(r[1]);
        pairs.z.push_back(r[2] - (scene.wall ? scene.wall->getHeight() : 0));
    }
    const int room = n + 16;
    for (auto* v : {&pairs.x, &pairs.y, &pairs.z}) v->resize(room);
    pairs.count = n;
    pairs.radius = 1;
    pairs.hasWall = scene.wall.has_value();
    pairs.torques = scene.particles.hasTorque[0];
    pairs.columns = columns;
    const int rows = (pairs.torques ? 6 : 3) * columns;
    pairs.loads.assign(rows, std::vector<double>(room, 1));
    std::vector<std::vector<std::vector<double>>> parts(threads);
    for (auto _ : state) {
        const auto task = [&](int thread) {
            parts[thread].assign(rows, std::vector<double>(room));
            addPlainPairs(pairs, thread, threads, parts[thread]);
        };
        if (threads == 1)
            task(0);
        else {
            pool.execute([&](ThreadPool&, int thread) { task(thread); });
            pool.waitForThreads();
        }
        for (int thread = 1; thread < threads; thread++)
            for (int row = 0; row < rows; row++)
                for (int i = 0; i < n; i++) parts[0][row][i] += parts[thread][row][i];
        benchmark::DoNotOptimize(parts.data());
        benchmark::ClobberMemory();
    }
    finish(state, n);
}
void roughProduct(benchmark::State& state, Kind kind, int64_t target) {
    const int n = state.range(0), columns = state.range(1), threads = state.range(2);
    state.SetLabel(restrictTo(target));
    ThreadPool pool(threads);
    const Scene scene(n, kind);
    const CpuRotnePragerYamakawa model =
        scene.mobility(threads > 1 ? onThreads(pool) : CpuRotnePragerYamakawa::ForRanges());
    const auto M = model.at({scene.positions});
    const Eigen::MatrixXd forces = Eigen::MatrixXd::Random(scene.particles.numRows, columns);
    Eigen::MatrixXd velocities;
    for (auto _ : state) {
        M->multiply(forces, velocities, {Accuracy::errorOfSinglePrecision});
        benchmark::DoNotOptimize(velocities.data());
        benchmark::ClobberMemory();
    }
    finish(state, n);
}

/**
 * Products, rough products and the yardstick; products.py takes ratios. The CPU time of the process
 * includes all threads.
 */
#define BESIDE(function, kind, target)                         \
    BENCHMARK_CAPTURE(function, kind##_##target, kind, target) \
        ->Name("beside/" #function "/" #kind "_" #target)      \
        ->Unit(benchmark::kMillisecond)                        \
        ->MeasureProcessCPUTime()                              \
        ->UseRealTime()                                        \
        ->ArgNames({"n", "columns", "threads"})                \
        ->ArgsProduct({{1000, 10000}, {1, 2}, {1, 2}})
#define PLAIN(kind, target)             \
    BESIDE(plainProduct, kind, target); \
    BESIDE(product, kind, target);      \
    BESIDE(roughProduct, kind, target)
PLAIN(Blobs, AVX2);
PLAIN(Blobs, best);
PLAIN(Spheres, AVX2);
PLAIN(Spheres, best);
PLAIN(BlobsAtWall, AVX2);
PLAIN(BlobsAtWall, best);
PLAIN(SpheresAtWall, AVX2);
PLAIN(SpheresAtWall, best);

void scalarProduct(benchmark::State& state) {
    const Scene scene(state.range(0), Spheres);
    const RotnePragerYamakawa model(scene.particles, 1.0);
    const auto M = model.at({scene.positions});
    const Eigen::MatrixXd forces = Eigen::MatrixXd::Random(scene.particles.numRows, 2);
    Eigen::MatrixXd velocities;
    for (auto _ : state) {
        M->multiply(forces, velocities);
        benchmark::DoNotOptimize(velocities.data());
        benchmark::ClobberMemory();
    }
    finish(state, state.range(0));
}
BENCHMARK(scalarProduct)->Arg(2)->Arg(10)->Arg(1000)->Unit(benchmark::kMillisecond);

void matrix(benchmark::State& state, Kind kind) {
    const int n = state.range(0), threads = state.range(1);
    restrictTo(best);
    ThreadPool pool(threads);
    const Scene scene(n, kind);
    const CpuRotnePragerYamakawa model =
        scene.mobility(threads > 1 ? onThreads(pool) : CpuRotnePragerYamakawa::ForRanges());
    const auto M = model.at({scene.positions});
    Eigen::MatrixXd mobility;
    for (auto _ : state) {
        M->dense(mobility);
        benchmark::DoNotOptimize(mobility.data());
        benchmark::ClobberMemory();
    }
    finish(state, n);
}
BENCHMARK_CAPTURE(matrix, Spheres, Spheres)
    ->ArgNames({"n", "threads"})
    ->Args({10, 1})
    ->Args({100, 1})
    ->Args({1000, 1})
    ->Args({1000, 2})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

BENCHMARK_CAPTURE(matrix, SpheresAtWall, SpheresAtWall)
    ->ArgNames({"n", "threads"})
    ->Args({10, 1})
    ->Args({1000, 1})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/** The matrix of the blobs of one multiblob, pair by pair, as on the Reference platform. */
template <class Model, class... Wall>
void scalarMatrix(benchmark::State& state, const Wall&... wall) {
    const Scene scene(state.range(0), BlobsAtWall);
    const Model model(scene.particles, 1.0, wall...);
    const auto M = model.at({scene.positions});
    Eigen::MatrixXd mobility;
    for (auto _ : state) {
        M->dense(mobility);
        benchmark::DoNotOptimize(mobility.data());
        benchmark::ClobberMemory();
    }
    finish(state, state.range(0));
}
void scalarBlobs(benchmark::State& state) { scalarMatrix<RotnePragerYamakawa>(state); }
void scalarBlobsAtWall(benchmark::State& state) {
    scalarMatrix<RotnePragerYamakawaWall>(state, *Scene(1, BlobsAtWall).wall);
}
BENCHMARK(scalarBlobs)->Arg(15)->Unit(benchmark::kMicrosecond);
BENCHMARK(scalarBlobsAtWall)->Arg(15)->Unit(benchmark::kMicrosecond);

/**
 * The functions that LangevinHI needs in a step: exp(-Sh) z and sqrt(1 - exp(-2Sh)) chi, here for
 * S^-1 = M.
 */
void decayAndNoise(benchmark::State& state) {
    const int n = state.range(0), threads = state.range(2);
    const double tolerance = std::pow(10, -state.range(1)),
                 h = 1.0 / (6 * M_PI);  // relaxation times of a sphere
    restrictTo(best);
    ThreadPool pool(threads);
    const Scene scene(n, Spheres);
    const CpuRotnePragerYamakawa model =
        scene.mobility(threads > 1 ? onThreads(pool) : CpuRotnePragerYamakawa::ForRanges());
    const auto M = model.at({scene.positions});
    const Eigen::MatrixXd x = Eigen::MatrixXd::Random(scene.particles.numRows, 2);
    Eigen::MatrixXd result;
    Lanczos lanczos(tolerance);
    const auto product = [&](double, const Eigen::MatrixXd& in, Eigen::MatrixXd& out) {
        M->multiply(in, out);
    };
    const std::vector<SpectralFunction> functions = {SpectralFunction::decay(h),
                                                     SpectralFunction::decayNoise(h)};
    for (auto _ : state) lanczos.apply(product, x, functions, result, Lanczos::NormOfSum);
    state.counters["products"] = lanczos.getNumProducts();
    state.counters["iterations"] = lanczos.getNumIterations();
}
BENCHMARK(decayAndNoise)
    ->ArgNames({"n", "digits", "threads"})
    ->Args({10, 3, 1})
    ->Args({100, 3, 1})
    ->Args({100, 6, 1})
    ->Args({1000, 3, 1})
    ->Args({1000, 3, 2})
    ->Args({10000, 3, 2})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
