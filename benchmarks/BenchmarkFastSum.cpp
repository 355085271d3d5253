// The cost and the errors of products by multipoles (FastSum), compared with sums over all pairs,
// for several errors, numbers and kinds of particles, unbounded and above a wall. Blobs and spheres
// are at random positions, at a volume fraction of 0.1, and may overlap.
//
// BenchmarkFastSum            Google Benchmark; counters: the relative error with random forces;
//                             memory; processor time of a product
// BenchmarkFastSum --errors   no times, but the largest error of each row of FastSum's table over
//                             scenes of many kinds, as JSON

#include <benchmark/benchmark.h>
#include <openmm/internal/ThreadPool.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <tuple>

#include "mobility/fastsum/FastSum.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using OpenMM::ThreadPool;
using OpenMM::Vec3;

namespace {

struct Scene {
    HydrodynamicParticles particles;
    std::vector<Vec3> positions;
    bool hasWall = false;

    CpuRotnePragerYamakawa model(const FastSum::ForRanges& forRanges = {},
                                 bool fastSums = true) const {
        std::optional<NoSlipPlane> wall;
        if (hasWall) wall.emplace(0, false);
        return CpuRotnePragerYamakawa(particles, 1.0, forRanges, wall, fastSums);
    }
    /** Square roots of own frictions, up to a common factor. */
    VectorXd scale() const {
        VectorXd s(particles.numRows);
        for (int i = 0; i < particles.size(); i++)
            for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k++)
                s[particles.firstRow[i] + k] =
                    k < 3 ? std::sqrt(particles.radii[i])
                          : std::sqrt(4.0 / 3 * std::pow(particles.radii[i], 3));
        return s;
    }
    MatrixXd randomForces() const {
        std::mt19937 random(2);
        std::normal_distribution<double> g;
        MatrixXd forces(particles.numRows, 1);
        for (int k = 0; k < particles.numRows; k++) forces(k, 0) = g(random);
        return scale().asDiagonal() * forces;
    }
};

enum SceneShape { Cloud, Layer, Shell, Clusters };

/**
 * @param fraction  the fraction of the volume (Cloud) or of the area that particles take; other
 *     shapes do not use it
 */
Scene makeScene(SceneShape shape, int n, bool spheres, bool equalRadii, bool hasWall,
                double fraction = 0.1) {
    Scene scene;
    scene.hasWall = hasWall;
    std::mt19937 random(1);
    std::uniform_real_distribution<double> u(0, 1);
    std::normal_distribution<double> g;
    const double size = std::cbrt(n * 4 * M_PI / 3 / fraction), area = std::sqrt(n * M_PI / 0.4);
    std::vector<Vec3> centres;
    for (int k = 0; k < 20; k++)
        centres.push_back(4 * size * Vec3(u(random), u(random), u(random)));
    for (int i = 0; i < n; i++) {
        const double a = equalRadii ? 1 : 0.3 + 1.7 * u(random);
        Vec3 r, d(g(random), g(random), g(random));
        switch (shape) {
            case Cloud: r = size * Vec3(u(random), u(random), u(random)); break;
            case Layer: r = Vec3(area * u(random), area * u(random), 1.5 * u(random)); break;
            case Shell:
                r = std::sqrt(n / 1.6) * (d * (1 / std::sqrt(d.dot(d))) + Vec3(0, 0, 1.1));
                break;
            case Clusters: r = centres[i % 20] + 0.1 * size * d; break;
        }
        scene.particles.add(a, spheres, i, -1);
        scene.positions.push_back(Vec3(r[0], r[1], std::abs(r[2]) + 1.001 * a));
    }
    return scene;
}

double processorSeconds() {
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

double relativeError(const Scene& scene, const MatrixXd& found, const MatrixXd& exact) {
    return (scene.scale().asDiagonal() * (found - exact)).norm() /
           (scene.scale().asDiagonal() * exact).norm();
}

FastSum::ForRanges onThreads(ThreadPool& pool) {
    if (pool.getNumThreads() == 1) return {};
    return [&pool](int count, const std::function<void(int, int)>& task) {
        const int parts = pool.getNumThreads();
        pool.execute([&](ThreadPool&, int thread) {
            task(static_cast<int>((long long)count * thread / parts),
                 static_cast<int>((long long)count * (thread + 1) / parts));
        });
        pool.waitForThreads();
    };
}

const Scene& sceneOf(int n, bool spheres, bool hasWall) {
    static std::map<std::tuple<int, bool, bool>, Scene> scenes;
    const std::tuple<int, bool, bool> key(n, spheres, hasWall);
    if (!scenes.count(key)) scenes[key] = makeScene(Cloud, n, spheres, true, hasWall);
    return scenes[key];
}
const MatrixXd& exactOf(int n, bool spheres, bool hasWall) {
    static std::map<std::tuple<int, bool, bool>, MatrixXd> results;
    MatrixXd& result = results[std::tuple<int, bool, bool>(n, spheres, hasWall)];
    if (result.size() == 0) {
        const Scene& scene = sceneOf(n, spheres, hasWall);
        const CpuRotnePragerYamakawa model = scene.model({}, false);
        model.at({scene.positions})->multiply(scene.randomForces(), result);
    }
    return result;
}

void finish(benchmark::State& state, double seconds) {
    state.counters["time_per_product"] = seconds / state.iterations();
}

/** The cost of a product. placement() measures the tree and the matrices of a placement. */
void product(benchmark::State& state, bool spheres, bool hasWall) {
    const int n = state.range(0);
    ThreadPool pool(state.range(2));
    const Scene& scene = sceneOf(n, spheres, hasWall);
    const FastSum::Accuracy* accuracy =
        FastSum::choose(std::pow(10, -state.range(1)), 1 << 30, hasWall);
    FastSum sum(scene.particles, hasWall, *accuracy, onThreads(pool));
    sum.moveTo(scene.positions, std::vector<double>(n, 1.0));
    const MatrixXd forces = scene.randomForces();
    MatrixXd velocities;
    sum.apply(forces, 1 / (8 * M_PI), velocities);
    const double start = processorSeconds();
    for (auto _ : state) sum.apply(forces, 1 / (8 * M_PI), velocities);
    finish(state, processorSeconds() - start);
    state.counters["error"] = relativeError(scene, velocities, exactOf(n, spheres, hasWall));
    state.counters["megabytes"] = sum.getMemory() / 1e6;
}

/** The cost of a new placement, apart from its products. */
void placement(benchmark::State& state, bool spheres, bool hasWall) {
    const int n = state.range(0);
    const Scene& scene = sceneOf(n, spheres, hasWall);
    FastSum sum(scene.particles, hasWall,
                *FastSum::choose(std::pow(10, -state.range(1)), 1 << 30, hasWall), {});
    sum.moveTo(scene.positions, std::vector<double>(n, 1.0));
    const double start = processorSeconds();
    for (auto _ : state) sum.moveTo(scene.positions, std::vector<double>(n, 1.0));
    finish(state, processorSeconds() - start);
}

/** The sum over all pairs, in double precision (digits 0) or with rounding to floats (6). */
void pairs(benchmark::State& state, bool spheres, bool hasWall) {
    const int n = state.range(0);
    ThreadPool pool(state.range(2));
    const Scene& scene = sceneOf(n, spheres, hasWall);
    const CpuRotnePragerYamakawa model = scene.model(onThreads(pool), false);
    const auto M = model.at({scene.positions});
    const MatrixXd forces = scene.randomForces();
    MatrixXd velocities;
    const double start = processorSeconds();
    for (auto _ : state)
        if (state.range(1) == 0)
            M->multiply(forces, velocities);
        else
            M->multiply(forces, velocities, {Accuracy::errorOfSinglePrecision});
    finish(state, processorSeconds() - start);
}

#define ROWS(function, name, spheres, wall, digits)                      \
    BENCHMARK_CAPTURE(function, name, spheres, wall)                     \
        ->ArgNames({"n", "digits", "threads"})                           \
        ->ArgsProduct({{1000, 3000, 10000, 30000, 100000}, digits, {1}}) \
        ->Iterations(1)                                                  \
        ->Unit(benchmark::kMillisecond)                                  \
        ->UseRealTime();
const std::vector<int64_t> errors = {2, 3, 4, 6}, precisions = {0, 6}, one = {3};
ROWS(product, Blobs, false, false, errors)
ROWS(pairs, Blobs, false, false, precisions)
ROWS(placement, Blobs, false, false, one)
ROWS(product, Spheres, true, false, errors)
ROWS(pairs, Spheres, true, false, precisions)
ROWS(product, BlobsAtWall, false, true, errors)
ROWS(pairs, BlobsAtWall, false, true, precisions)
ROWS(product, SpheresAtWall, true, true, errors)
ROWS(pairs, SpheresAtWall, true, true, precisions)

double norm(const MatrixXd& A) {
    VectorXd v = VectorXd::Ones(A.cols());
    v[0] = 2;
    double value = 0;
    for (int i = 0; i < 100; i++) {
        v.normalize();
        const VectorXd w = A * v;
        value = w.norm();
        v = A.transpose() * w;
    }
    return value;
}

/**
 * Print errors of the whole matrix of a few particles in small cubes, with the order and opening of
 * the row 1e-3: for random forces, in the norm of M, and in the norm of energies.
 */
void printNorms() {
    for (SceneShape shape : {Cloud, Layer, Shell, Clusters})
        for (bool hasWall : {false, true}) {
            const Scene scene = makeScene(shape, 400, false, true, hasWall, 0.4);
            FastSum::Accuracy accuracy = *FastSum::choose(1e-3, 1 << 30, hasWall);
            accuracy.leafSize = 8;
            const CpuRotnePragerYamakawa model = scene.model({}, false);
            MatrixXd M, fast;
            model.at({scene.positions})->dense(M);
            FastSum sum(scene.particles, hasWall, accuracy, {});
            sum.moveTo(scene.positions, std::vector<double>(400, 1.0));
            sum.apply(MatrixXd::Identity(M.rows(), M.cols()), 1 / (8 * M_PI), fast);
            const MatrixXd E = fast - M;
            const Eigen::LLT<MatrixXd> factor(M);
            MatrixXd whitened = factor.matrixL().solve(E);
            whitened = factor.matrixL().solve(whitened.transpose().eval());
            const char* const names[] = {"cloud", "layer", "shell", "clusters"};
            printf("  \"matrix, %s %s\": {\"random\": %.2e, \"norm\": %.2e, \"energies\": %.2e},\n",
                   names[shape], hasWall ? "wall" : "unbounded", E.norm() / M.norm(),
                   norm(E) / norm(M), norm(whitened));
        }
}

/**
 * Print the largest error of each row over scenes: for random forces, and, relative to the norm of
 * M, for forces along one direction.
 */
void printErrors() {
    printf("{\n");
    printNorms();
    const char* const names[] = {"cloud", "layer", "shell", "clusters"};
    const double tolerances[] = {1e-2, 1e-3, 1e-4, 1e-5, 1e-6};
    std::map<std::pair<double, bool>, std::pair<double, std::string>> worst;
    for (int n : {8000})
        for (SceneShape shape : {Cloud, Layer, Shell, Clusters})
            for (int kind = 0; kind < 4; kind++)
                for (bool hasWall : {false, true})
                    for (double fraction : {0.01, 0.4, 2.0}) {
                        if (shape != Cloud && fraction != 0.4) continue;
                        const bool spheres = kind % 2, equal = kind / 2;
                        const Scene scene = makeScene(shape, n, spheres, equal, hasWall, fraction);
                        const MatrixXd forces = scene.randomForces();
                        MatrixXd exact, found;
                        const CpuRotnePragerYamakawa model = scene.model({}, false);
                        model.at({scene.positions})->multiply(forces, exact);
                        for (double tolerance : tolerances) {
                            FastSum sum(scene.particles, hasWall,
                                        *FastSum::choose(tolerance, 1 << 30, hasWall), {});
                            sum.moveTo(scene.positions, std::vector<double>(n, 1.0));
                            sum.apply(forces, 1 / (8 * M_PI), found);
                            const double error = relativeError(scene, found, exact);
                            auto& most = worst[{-tolerance, hasWall}];
                            if (error > most.first)
                                most = {error, std::to_string(n) +
                                                   (spheres ? " spheres, " : " blobs, ") +
                                                   names[shape] +
                                                   (equal ? ", equal radii" : ", unequal radii")};
                        }
                    }
    bool first = true;
    for (const auto& row : worst) {
        printf("%s  \"%g %s\": {\"error\": %.2e, \"scene\": \"%s\"}", first ? "" : ",\n",
               -row.first.first, row.first.second ? "wall" : "unbounded", row.second.first,
               row.second.second.c_str());
        first = false;
    }
    printf("\n}\n");
}

}  // namespace

int main(int argc, char** argv) {
    if (argc > 1 && !strcmp(argv[1], "--errors")) {
        printErrors();
        return 0;
    }
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}
