// The cost of periodic Rotne-Prager-Yamakawa without a matrix (RotnePragerYamakawaGrid): products,
// their pairs and waves, and the preparation of each placement. For comparison, the product of
// force coupling on a grid, and FFTW's own transforms of the same size, planned by FFTW_MEASURE.
// The cost of noise, for the model's own noise and for a root of the whole matrix. Particles are at
// volume fraction 0.2 on a cubic lattice, displaced at random without overlaps, with one thread.
// Arguments: particles, minus the exponent of the tolerance; for `splitting` also xi in hundredths
// of 1/radius.

#include <benchmark/benchmark.h>
#include <fftw3.h>

#include <cmath>
#include <random>

#include "linearalgebra/Lanczos.h"
#include "mobility/models/ewald/NearField.h"
#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"
#include "mobility/models/ewald/WaveField.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"

using namespace RigidHIPlugin;
using Eigen::MatrixXd;
using OpenMM::Vec3;

namespace {

struct Scene {
    HydrodynamicParticles particles;
    Placement placement;
    Scene(int n, bool torques) {
        const double edge = std::cbrt(n * 4 * M_PI / 3 / 0.2);
        placement.box = {{Vec3(edge, 0, 0), Vec3(0, edge, 0), Vec3(0, 0, edge)}};
        std::mt19937 random(1);
        const int m = std::lround(std::cbrt(n));
        const double cell = edge / m;
        std::uniform_real_distribution<double> shaken(1 - cell / 2, cell / 2 - 1);
        for (int i = 0; i < n; i++) {
            particles.add(1, torques, i, -1);
            placement.positions.push_back(Vec3(cell * (i % m) + shaken(random),
                                               cell * (i / m % m) + shaken(random),
                                               cell * (i / m / m) + shaken(random)));
        }
    }
};

double toleranceOf(const benchmark::State& state) {
    return std::pow(10.0, -(double)state.range(1));
}

/** Pairs and waves, as in a MobilityAt of the model. */
struct Parts {
    const Scene scene;
    const std::vector<EwaldKind> kinds;
    const SplitBox inBox;
    const EwaldSplitting& splitting;
    NearField near;
    WaveField waves;
    CpuGridFluid fluid;
    const MatrixXd forces;
    MatrixXd velocities;
    Parts(const benchmark::State& state, bool torques = false, double xi = 0)
        : scene(state.range(0), torques), kinds(kindsOf(scene.particles)),
          inBox(kinds, EwaldSplitting(kinds, toleranceOf(state), 0, scene.placement.box, xi),
                scene.placement.box),
          splitting(inBox.splitting), near(scene.particles), waves(scene.particles, kinds),
          forces(Eigen::VectorXd::LinSpaced(scene.particles.numRows, -1, 1)) {
        near.setTables(inBox.tables, std::vector<int>(scene.particles.size(), 0), splitting.shape);
        waves.setBox(inBox);
        velocities.setZero(forces.rows(), 1);
        makePairs();
        makeWeights();
    }
    void makePairs() { near.moveTo(scene.placement.positions, false, inBox.spacing, ranges()); }
    void makeWeights() { waves.moveTo(scene.placement.positions, false); }
    Ranges ranges() const {
        return [this](int count, const std::function<void(int, int)>& task) {
            fluid.forRanges(count, task);
        };
    }
    void multiplyPairs() { near.multiply(forces.data(), velocities.data(), ranges()); }
    void multiplyWaves(bool roughly = false) {
        waves.addProduct(fluid, 1, roughly, forces.data(), velocities.data());
    }
    void name(benchmark::State& state) const {
        state.counters["xi"] = splitting.xi;
        state.counters["nodes along an edge"] = splitting.shape.size[0];
        state.counters["width of stencils"] = waves.getChannels()[0].stencils->largestWidth(0);
        state.counters["neighbours"] = (double)near.getNumPairs() / scene.particles.size();
        state.counters["model_ms"] = 1e3 * splitting.seconds;
    }
};

void multiply(benchmark::State& state, bool torques, bool roughly) {
    Parts p(state, torques);
    const auto product = [&] {
        p.multiplyPairs();
        p.multiplyWaves(roughly);
    };
    product();  // only the first step allocates memory
    for (auto _ : state) product();
    p.name(state);
}
void product(benchmark::State& state) { multiply(state, false, false); }
void roughProduct(benchmark::State& state) { multiply(state, false, true); }
void productWithTorques(benchmark::State& state) { multiply(state, true, false); }

void pairs(benchmark::State& state) {
    Parts p(state);
    for (auto _ : state) p.multiplyPairs();
    p.name(state);
}
void waves(benchmark::State& state) {
    Parts p(state);
    p.multiplyWaves();
    for (auto _ : state) p.multiplyWaves();
    const GridSeconds before = p.fluid.getSeconds();
    p.multiplyWaves();
    const GridSeconds after = p.fluid.getSeconds();
    state.counters["spreading_ms"] = 1e3 * (after.spreading - before.spreading);
    state.counters["transforms_ms"] = 1e3 * (after.transforms - before.transforms);
    state.counters["averaging_ms"] = 1e3 * (after.averaging - before.averaging);
    p.name(state);
}
void makingPairs(benchmark::State& state) {
    Parts p(state);
    for (auto _ : state) p.makePairs();
    p.name(state);
}
void makingWeights(benchmark::State& state) {
    Parts p(state);
    for (auto _ : state) p.makeWeights();
}
/** A product with splittings other than the fastest. */
void splitting(benchmark::State& state) {
    Parts p(state, false, 0.01 * state.range(2));
    const auto both = [&] {
        p.multiplyPairs();
        p.multiplyWaves();
    };
    both();
    for (auto _ : state) both();
    p.name(state);
}
/**
 * Slips (random surface velocities) with the covariance M at a new placement: a field of waves, and
 * a root of the mobility of pairs.
 */
void noise(benchmark::State& state) {
    const Scene scene(state.range(0), false);
    const RotnePragerYamakawaGrid model(scene.particles, 1, toleranceOf(state), 0,
                                        std::make_shared<CpuGridFluid>());
    std::unique_ptr<RandomField> field;
    MatrixXd slips;
    Placement placement = scene.placement;
    const auto draw = [&] {
        placement.positions[0][0] += 1e-9;  // another position, so that pairs have to be made anew
        model.randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw, placement.box,
                                  field);
        field->slipsAt(placement, false, slips);
    };
    draw();
    for (auto _ : state) draw();
}
/**
 * The same slips by Lanczos' method with products with the whole of M, in single precision where
 * the tolerance allows this.
 */
void noiseByOneRoot(benchmark::State& state) {
    const Scene scene(state.range(0), false);
    const double tolerance = toleranceOf(state);
    const RotnePragerYamakawaGrid model(scene.particles, 1, tolerance, 0,
                                        std::make_shared<CpuGridFluid>());
    const auto at = model.at(scene.placement);
    MatrixXd W(scene.particles.numRows, 1), slips;
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    for (int i = 0; i < W.rows(); i++) W(i, 0) = normal(random);
    Lanczos lanczos(tolerance);
    const auto product = [&](double error, const MatrixXd& x, MatrixXd& y) {
        at->multiply(x, y, {error});
    };
    const double single = Accuracy::errorOfSinglePrecision;
    const InexactProduct inexact = {single, single, 0,
                                    tolerance >= Accuracy::leastToleranceOfSinglePrecision};
    const auto root = [&] {
        lanczos.apply(product, W, {SpectralFunction::squareRoot()}, slips, Lanczos::OwnNorm,
                      {inexact});
    };
    root();
    for (auto _ : state) root();
    state.counters["products"] = lanczos.getNumProducts();
}
/** Force coupling's product for the same particles. */
void forceCoupling(benchmark::State& state) {
    const Scene scene(state.range(0), false);
    const ForceCouplingGrid model(scene.particles, 1, toleranceOf(state), 0,
                                  std::make_shared<CpuGridFluid>());
    const auto at = model.at(scene.placement);
    const MatrixXd forces = Eigen::VectorXd::LinSpaced(scene.particles.numRows, -1, 1);
    MatrixXd velocities;
    at->multiply(forces, velocities);
    for (auto _ : state) at->multiply(forces, velocities);
    state.counters["nodes along an edge"] = model.shapeFor(scene.placement.box).size[0];
}
/**
 * Three forward and three backward transforms, in place, each of the whole grid at once, on the
 * grid of the product.
 */
void sixTransforms(benchmark::State& state) {
    const Scene scene(state.range(0), false);
    const int n =
        EwaldSplitting(kindsOf(scene.particles), toleranceOf(state), 0, scene.placement.box)
            .shape.size[0];
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
    state.counters["nodes along an edge"] = n;
}

}  // namespace

#define TIMED ->Unit(benchmark::kMillisecond)->MinTime(0.1)
#define SIZES ->ArgsProduct({{1000, 10648, 103823}, {3, 4, 6}}) TIMED
BENCHMARK(product) SIZES;
BENCHMARK(forceCoupling) SIZES;
BENCHMARK(sixTransforms) SIZES;
BENCHMARK(roughProduct)->ArgsProduct({{1000, 10648, 103823}, {3, 4}}) TIMED;
BENCHMARK(productWithTorques) SIZES;
BENCHMARK(pairs) SIZES;
BENCHMARK(waves) SIZES;
BENCHMARK(makingPairs) SIZES;
BENCHMARK(makingWeights) SIZES;
BENCHMARK(noise)->ArgsProduct({{1000, 10648}, {3, 6}}) TIMED;
BENCHMARK(noiseByOneRoot)->ArgsProduct({{1000, 10648}, {3, 6}}) TIMED;
BENCHMARK(splitting)->ArgsProduct({{10648}, {3, 6}, {20, 25, 30, 35, 40, 50, 60}}) TIMED;

BENCHMARK_MAIN();
