// The cost of a slip channel on a grid: on a mirrored grid, and by the images of particles in a
// periodic fluid of twice the width, which gives the same flow and field. For comparison, FFTW's
// transforms along y of one column of eight planes: of the whole period, of half of it, and FFTW's
// own cosine and sine transforms of as many numbers. Blobs are at random positions at volume
// fraction 0.2, with one thread. Arguments: blobs, width over their radius, tolerance 10^-n.

#include <benchmark/benchmark.h>
#include <fftw3.h>

#include <cmath>
#include <functional>
#include <random>

#include "mobility/models/forcecoupling/CpuGridFluid.h"

using namespace RigidHIPlugin;
using OpenMM::Vec3;

namespace {

struct Scene {
    HydrodynamicParticles particles;
    std::vector<Vec3> positions;
    BoxVectors twice;
    Scene(int n, double width, bool images) {
        const double edge = std::sqrt(n * 4 * M_PI / 3 / 0.2 / width);
        twice = {{Vec3(edge, 0, 0), Vec3(0, 2 * width, 0), Vec3(0, 0, edge)}};
        std::mt19937 random(1);
        std::uniform_real_distribution<double> u(0, 1);
        for (int i = 0; i < n; i++) {
            particles.add(1, false, i, -1);
            positions.push_back(Vec3(edge * u(random), width * u(random), edge * u(random)));
        }
        for (int i = 0; images && i < n; i++) {
            particles.add(1, false, i, -1);
            positions.push_back(Vec3(positions[i][0], -positions[i][1], positions[i][2]));
        }
    }
};

/** A scene with the grid, stencils and fluid that exist at the beginning of a step. */
struct Prepared {
    const Scene scene;
    const GridResolution resolution;
    GridShape shape;
    GridStencils stencils;
    CpuGridFluid fluid;
    GridField field;
    Prepared(const benchmark::State& state, bool images)
        : scene(state.range(0), state.range(1), images),
          resolution(scene.particles, std::pow(10.0, -state.range(2)), 0),
          shape(resolution.shapeFor(scene.twice)), stencils(scene.particles, resolution) {
        shape.mirrored = !images;
        stencils.moveTo(shape, scene.positions, false);
        // Only the first step allocates memory, so take it here.
        fluid.draw(stencils, 1, NoiseStream(), NoiseStream::RandomField, field);
    }
    void name(benchmark::State& state) const {
        state.SetLabel(std::to_string(shape.size[0]) + " x " + std::to_string(shape.size[1]) +
                       "/2 x " + std::to_string(shape.size[2]));
    }
};

template <bool images>
void product(benchmark::State& state) {
    Prepared p(state, images);
    const Eigen::MatrixXd forces = Eigen::VectorXd::LinSpaced(p.scene.particles.numRows, -1, 1);
    Eigen::MatrixXd velocities;
    p.fluid.multiply(p.stencils, 1, forces, velocities);
    for (auto _ : state) p.fluid.multiply(p.stencils, 1, forces, velocities);
    p.name(state);
}

template <bool images>
void roughProduct(benchmark::State& state) {
    Prepared p(state, images);
    const Eigen::MatrixXd forces = Eigen::VectorXd::LinSpaced(p.scene.particles.numRows, -1, 1);
    Eigen::MatrixXd velocities;
    p.fluid.multiplyInSingle(p.stencils, 1, forces, velocities);
    for (auto _ : state) p.fluid.multiplyInSingle(p.stencils, 1, forces, velocities);
    p.name(state);
}

template <bool images>
void randomField(benchmark::State& state) {
    Prepared p(state, images);
    for (auto _ : state)
        p.fluid.draw(p.stencils, 1, NoiseStream(), NoiseStream::RandomField, p.field);
    p.name(state);
}

template <bool images>
void average(benchmark::State& state) {
    Prepared p(state, images);
    Eigen::VectorXd velocities;
    for (auto _ : state) p.fluid.average(p.field, p.stencils, velocities);
    p.name(state);
}

template <bool images>
void stencils(benchmark::State& state) {
    Prepared p(state, images);
    for (auto _ : state) p.stencils.moveTo(p.shape, p.scene.positions, false);
    p.name(state);
}

/**
 * Transforms of a column of modes of eight planes.
 *
 * @param make  makes the plan of the transforms for a period of state.range(0) numbers
 */
void transform(benchmark::State& state,
               const std::function<fftw_plan(int period, double* from, double* to)>& make) {
    const int period = state.range(0), planes = 8;
    double *from = fftw_alloc_real(2 * planes * (period + 2)),
           *to = fftw_alloc_real(2 * planes * (period + 2));
    const fftw_plan plan = make(period, from, to);
    for (int i = 0; i < 2 * planes * period; i++) from[i] = std::cos(i);
    for (auto _ : state) fftw_execute(plan);
    fftw_destroy_plan(plan);
    fftw_free(from);
    fftw_free(to);
}
fftw_plan complexOnes(int n, double* from, double* to) {
    return fftw_plan_many_dft(1, &n, 8, reinterpret_cast<fftw_complex*>(from), nullptr, 8, 1,
                              reinterpret_cast<fftw_complex*>(to), nullptr, 8, 1, FFTW_FORWARD,
                              FFTW_ESTIMATE);
}
fftw_plan realOnes(int n, double* from, double* to, fftw_r2r_kind kind) {
    return fftw_plan_many_r2r(1, &n, 16, from, nullptr, 16, 1, to, nullptr, 16, 1, &kind,
                              FFTW_ESTIMATE);
}
void wholePeriod(benchmark::State& state) { transform(state, complexOnes); }
void halfPeriod(benchmark::State& state) {
    transform(state, [](int n, double* from, double* to) { return complexOnes(n / 2, from, to); });
}
/** Cosine transforms with nodes half a spacing away from walls. */
void cosines(benchmark::State& state) {
    transform(state, [](int n, double* from, double* to) {
        return realOnes(n / 2, from, to, FFTW_REDFT10);
    });
}
void sines(benchmark::State& state) {
    transform(state, [](int n, double* from, double* to) {
        return realOnes(n / 2, from, to, FFTW_RODFT10);
    });
}
/** Cosine transforms with nodes on walls. */
void cosinesFromWall(benchmark::State& state) {
    transform(state, [](int n, double* from, double* to) {
        return realOnes(n / 2 + 1, from, to, FFTW_REDFT00);
    });
}
void sinesFromWall(benchmark::State& state) {
    transform(state, [](int n, double* from, double* to) {
        return realOnes(n / 2 - 1, from, to, FFTW_RODFT00);
    });
}

}  // namespace

#define CASES                  \
    ->Args({1000, 8, 2})       \
        ->Args({1000, 8, 3})   \
        ->Args({8000, 20, 2})  \
        ->Args({8000, 20, 3})  \
        ->Args({32000, 80, 2}) \
        ->Args({32000, 80, 3})
#define BOTH(function)                                                      \
    BENCHMARK_TEMPLATE(function, true)->Name(#function " by images") CASES; \
    BENCHMARK_TEMPLATE(function, false)->Name(#function) CASES;
BOTH(product)
BOTH(roughProduct)
BOTH(randomField)
BOTH(average)
BOTH(stencils)

#define PERIODS ->Arg(32)->Arg(64)->Arg(140)->Arg(256)
BENCHMARK(wholePeriod) PERIODS;
BENCHMARK(halfPeriod) PERIODS;
BENCHMARK(cosines) PERIODS;
BENCHMARK(sines) PERIODS;
BENCHMARK(cosinesFromWall) PERIODS;
BENCHMARK(sinesFromWall) PERIODS;

BENCHMARK_MAIN();
