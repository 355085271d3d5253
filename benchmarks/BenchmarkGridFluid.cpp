// The cost of force coupling on a grid: products, random fields and averages, compared with FFTW's
// own transforms of the same size, planned by FFTW_MEASURE. Blobs are at volume fraction 0.2, the
// tolerance is 1e-4, and one thread runs. A product has three forward and three backward
// transforms, a random field three backward ones.

#include <benchmark/benchmark.h>
#include <fftw3.h>

#include <cmath>
#include <random>

#include "mobility/models/forcecoupling/CpuGridFluid.h"

using namespace RigidHIPlugin;
using OpenMM::Vec3;

namespace {

struct Scene {
    HydrodynamicParticles particles;
    std::vector<Vec3> positions;
    BoxVectors box;
    Scene(int n) {
        const double edge = std::cbrt(n * 4 * M_PI / 3 / 0.2);
        box = {{Vec3(edge, 0, 0), Vec3(0, edge, 0), Vec3(0, 0, edge)}};
        std::mt19937 random(1);
        std::uniform_real_distribution<double> u(0, edge);
        for (int i = 0; i < n; i++) {
            particles.add(1, false, i, -1);
            positions.push_back(Vec3(u(random), u(random), u(random)));
        }
    }
};

/** A scene with the grid, stencils and fluid that exist at the beginning of a step. */
struct Prepared {
    const Scene scene;
    const GridResolution resolution;
    GridStencils stencils;
    CpuGridFluid fluid;
    Prepared(int n)
        : scene(n), resolution(scene.particles, 1e-4, 0), stencils(scene.particles, resolution) {
        stencils.moveTo(resolution.shapeFor(scene.box), scene.positions, false);
    }
    void name(benchmark::State& state) const {
        state.counters["nodes along an edge"] = stencils.getShape().size[0];
        state.counters["width of stencils"] = stencils.largestWidth(0);
    }
};

void stencils(benchmark::State& state) {
    Prepared p(state.range(0));
    for (auto _ : state) p.stencils.moveTo(p.stencils.getShape(), p.scene.positions, false);
    p.name(state);
}

void product(benchmark::State& state) {
    Prepared p(state.range(0));
    const Eigen::MatrixXd forces = Eigen::VectorXd::LinSpaced(p.scene.particles.numRows, -1, 1);
    Eigen::MatrixXd velocities;
    p.fluid.multiply(p.stencils, 1, forces,
                     velocities);  // only the first step allocates memory
    for (auto _ : state) p.fluid.multiply(p.stencils, 1, forces, velocities);
    p.name(state);
}

/** Products in single precision, as in iterations at a tolerance of 5e-5 and above. */
void roughProduct(benchmark::State& state) {
    Prepared p(state.range(0));
    const Eigen::MatrixXd forces = Eigen::VectorXd::LinSpaced(p.scene.particles.numRows, -1, 1);
    Eigen::MatrixXd velocities;
    p.fluid.multiplyInSingle(p.stencils, 1, forces, velocities);
    for (auto _ : state) p.fluid.multiplyInSingle(p.stencils, 1, forces, velocities);
    p.name(state);
}

void randomField(benchmark::State& state) {
    Prepared p(state.range(0));
    GridField field;
    p.fluid.draw(p.stencils, 1, NoiseStream(), NoiseStream::RandomField, field);
    for (auto _ : state)
        p.fluid.draw(p.stencils, 1, NoiseStream(), NoiseStream::RandomField, field);
    p.name(state);
}

void average(benchmark::State& state) {
    Prepared p(state.range(0));
    GridField field;
    Eigen::VectorXd velocities;
    p.fluid.draw(p.stencils, 1, NoiseStream(), NoiseStream::RandomField, field);
    for (auto _ : state) p.fluid.average(field, p.stencils, velocities);
    p.name(state);
}

void averageGradients(benchmark::State& state) {
    Prepared p(state.range(0));
    GridField field;
    Eigen::MatrixXd gradients;
    p.fluid.draw(p.stencils, 1, NoiseStream(), NoiseStream::RandomField, field);
    for (auto _ : state) p.fluid.averageGradients(field, p.stencils, gradients);
    p.name(state);
}

/** Three forward and three backward transforms, in place, each of the whole grid at once. */
void sixTransforms(benchmark::State& state) {
    const Prepared p(state.range(0));
    const int n = p.stencils.getShape().size[0];
    const size_t numbers = (size_t)n * n * 2 * (n / 2 + 1);
    double* grid = fftw_alloc_real(numbers);
    const fftw_plan there = fftw_plan_dft_r2c_3d(n, n, n, grid, (fftw_complex*)grid, FFTW_MEASURE),
                    back = fftw_plan_dft_c2r_3d(n, n, n, (fftw_complex*)grid, grid, FFTW_MEASURE);
    std::fill(grid, grid + numbers, 0.0);
    for (auto _ : state)
        for (int c = 0; c < 3; c++) {
            fftw_execute(there);
            fftw_execute(back);
        }
    fftw_destroy_plan(there);
    fftw_destroy_plan(back);
    fftw_free(grid);
    p.name(state);
}

}  // namespace

#define SIZES ->Arg(1000)->Arg(10000)->Arg(22363)->Arg(100000)
BENCHMARK(sixTransforms) SIZES;
BENCHMARK(product) SIZES;
BENCHMARK(roughProduct) SIZES;
BENCHMARK(randomField) SIZES;
BENCHMARK(average) SIZES;
BENCHMARK(averageGradients) SIZES;
BENCHMARK(stencils) SIZES;

BENCHMARK_MAIN();
