// The cost of no-slip walls on a grid: products and random velocities of force coupling and of
// Rotne-Prager-Yamakawa in a channel, above a wall and in a film, compared with a fluid on the same
// nodes without planes, which is periodic along all axes. (Of Rotne-Prager-Yamakawa it has the same
// splitting into pairs and waves, too.) And random velocities by a root of the whole mobility, by
// Lanczos' method, with the number of its products. Blobs of radius 1 are in shaken layers between
// the planes, at volume fraction 0.2 and without overlaps, with one thread. Arguments: blobs,
// height of the fluid in radii. planes.py runs this program and takes ratios.

#include <benchmark/benchmark.h>

#include <cmath>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <tuple>

#include "linearalgebra/Lanczos.h"
#include "mobility/models/confined/ConfinedForceCoupling.h"
#include "mobility/models/confined/ConfinedRandomField.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawaGrid.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace RigidHIPlugin;
using Eigen::MatrixXd;
using OpenMM::Vec3;

namespace {

const double tolerance = 1e-3, viscosity = 1, volumeFraction = 0.2;

struct Scene {
    HydrodynamicParticles particles;
    Placement placement;

    Scene(int n, double height) {
        const int layers = std::max(1L, std::lround(height / 3)),
                  side = std::ceil(std::sqrt((double)n / layers));
        const double across = height / layers,
                     along = std::sqrt(4 * M_PI / 3 / volumeFraction / across);
        std::mt19937 random(1);
        const auto inCell = [&](int cell, double size) {
            const double most = size / 2 - 1;
            return (cell + 0.5) * size +
                   std::uniform_real_distribution<double>(-most, most)(random);
        };
        for (int i = 0; i < n; i++) {
            particles.add(1, false, i, -1);
            const int cell = i / layers;
            placement.positions.push_back(Vec3(inCell(cell % side, along),
                                               inCell(cell / side, along),
                                               inCell(i % layers, across)));
        }
        placement.box = {Vec3(side * along, 0, 0), Vec3(0, side * along, 0), Vec3(0, 0, height)};
    }
};

struct Fluid {
    MobilityForce::Model model;
    MobilityForce::Boundary boundary;
    bool withPlanes;  // otherwise periodic, on the nodes of this boundary

    std::string name() const {
        return std::string(traitsOf(model).name) + "/" + traitsOf(boundary).name +
               (withPlanes ? "" : "/periodic");
    }
};

ConfiningPlanes planesOf(MobilityForce::Boundary boundary, double height) {
    MobilityForce force;
    force.setBoundary(boundary);
    force.setChannelWalls(0, height);
    return ConfiningPlanes(force, false);
}

std::string nodesOf(const GridShape& shape) {
    return std::to_string(shape.size[0]) + " x " + std::to_string(shape.size[1]) + " x " +
           std::to_string(shape.size[2]);
}

/** A model at a scene. */
struct Prepared {
    const Scene scene;
    std::unique_ptr<const MobilityModel> confined, periodic;
    Placement placement;  // of the model that is timed
    std::string nodes;

    Prepared(const Fluid& fluid, int n, double height) : scene(n, height) {
        // All models in turn use one fluid, whose memory is that of the last size.
        static const auto grid = std::make_shared<CpuGridFluid>();
        const ConfiningPlanes planes = planesOf(fluid.boundary, height);
        if (fluid.model == MobilityForce::ForceCoupling)
            makeForceCoupling(planes, fluid.withPlanes, grid);
        else
            makeRotnePragerYamakawa(planes, fluid.withPlanes, height, grid);
    }
    const MobilityModel& model() const { return periodic ? *periodic : *confined; }

private:
    void makeForceCoupling(const ConfiningPlanes& planes, bool withPlanes,
                           const std::shared_ptr<GridFluid>& grid) {
        auto made = std::make_unique<ConfinedForceCoupling>(scene.particles, viscosity, planes,
                                                            tolerance, 0, grid);
        Placement inPeriodic;
        made->toPeriodic(scene.placement, made->periodFor(scene.placement.positions), inPeriodic);
        nodes = nodesOf(made->inPeriodicBox().nodesFor(inPeriodic.box));
        placement = withPlanes ? scene.placement : inPeriodic;
        confined = std::move(made);
        if (withPlanes) return;
        // Planes that are none leave the nodes as they are.
        auto without = std::make_unique<ForceCouplingGrid>(
            scene.particles, viscosity, tolerance, 0, grid, false,
            [](const GridShape&) { return std::shared_ptr<const GridPlanes>(); });
        nodes += nodesOf(without->shapeFor(placement.box)) == nodes ? "" : " (others)";
        periodic = std::move(without);
    }
    void makeRotnePragerYamakawa(const ConfiningPlanes& planes, bool withPlanes, double height,
                                 const std::shared_ptr<GridFluid>& grid) {
        auto made = std::make_unique<ConfinedRotnePragerYamakawaGrid>(scene.particles, viscosity,
                                                                      tolerance, 0, planes, grid);
        ConfinedRotnePragerYamakawaGrid::Lifted lifted;
        made->lift(scene.placement, false, lifted);
        const auto base = made->baseFor(scene.placement.box, lifted.top, lifted.nearest);
        Placement inBase = scene.placement;
        inBase.box[2] = Vec3(0, 0, base.period);
        for (Vec3& x : inBase.positions) x[2] -= 0.5 * base.height;
        nodes = nodesOf(base.model->splittingFor(inBase.box).shape);
        placement = withPlanes ? scene.placement : inBase;
        if (!withPlanes) {
            auto without = std::make_unique<RotnePragerYamakawaGrid>(
                scene.particles, viscosity, base.model->getTolerance(), 0, grid,
                WallMaker{base.longest, 0, {}});
            nodes +=
                nodesOf(without->splittingFor(placement.box).shape) == nodes ? "" : " (others)";
            periodic = std::move(without);
        }
        confined = std::move(made);
    }
};

/** The planes of a box are made once. */
Prepared& prepared(const Fluid& fluid, const benchmark::State& state) {
    static std::map<std::tuple<std::string, int, int>, std::unique_ptr<Prepared>> all;
    const int n = state.range(0), height = state.range(1);
    auto& made = all[{fluid.name(), n, height}];
    if (!made) made = std::make_unique<Prepared>(fluid, n, height);
    return *made;
}

void product(benchmark::State& state, const Fluid& fluid) {
    const Prepared& p = prepared(fluid, state);
    const auto at = p.model().at(p.placement);
    const MatrixXd forces = Eigen::VectorXd::LinSpaced(p.scene.particles.numRows, -1, 1);
    MatrixXd velocities;
    at->multiply(forces, velocities);  // only the first one allocates memory
    for (auto _ : state) at->multiply(forces, velocities);
    state.SetLabel(p.nodes);
}

/** Random velocities at a new placement, by the model's own field. */
void noise(benchmark::State& state, const Fluid& fluid) {
    const Prepared& p = prepared(fluid, state);
    Placement placement = p.placement;
    std::unique_ptr<RandomField> field;
    MatrixXd slips;
    const auto draw = [&] {
        placement.positions[0][0] += 1e-9;  // another position, so that pairs have to be made anew
        p.model().randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw, placement.box,
                                      field);
        field->slipsAt(placement, false, slips);
    };
    draw();
    for (auto _ : state) draw();
    state.SetLabel(p.nodes);
    if (auto* ofPairs = dynamic_cast<const ConfinedRandomField*>(field.get()))
        state.counters["iterationsOfPairs"] = ofPairs->getNumIterations();
}

/** Likewise by a root of the whole mobility, in single precision where a step would use it. */
void noiseByProducts(benchmark::State& state, const Fluid& fluid) {
    const Prepared& p = prepared(fluid, state);
    const auto at = p.model().at(p.placement);
    MatrixXd W(p.scene.particles.numRows, 1), slips;
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    for (int i = 0; i < W.rows(); i++) W(i, 0) = normal(random);
    Lanczos lanczos(tolerance);
    const double single = Accuracy::errorOfSinglePrecision;
    const InexactProduct inexact = {single, single, 0,
                                    tolerance >= Accuracy::leastToleranceOfSinglePrecision};
    const auto root = [&] {
        lanczos.apply(
            [&](double error, const MatrixXd& x, MatrixXd& y) { at->multiply(x, y, {error}); }, W,
            {SpectralFunction::squareRoot()}, slips, Lanczos::OwnNorm, {inexact});
    };
    for (auto _ : state) root();  // so long that memory allocated in it does not count
    state.SetLabel(p.nodes);
    state.counters["products"] = lanczos.getNumProducts();
}

void add(const char* what, void (*run)(benchmark::State&, const Fluid&), const Fluid& fluid) {
    auto* added = benchmark::RegisterBenchmark((std::string(what) + "/" + fluid.name()).c_str(),
                                               [=](benchmark::State& state) { run(state, fluid); });
    // The grids of Rotne-Prager-Yamakawa along walls are fine, so large scenes take long.
    const bool isFast = fluid.model == MobilityForce::ForceCoupling && run != noiseByProducts;
    for (int n : {1000, 10000})
        for (int height : {3, 6, 20})
            if (n == 1000 || height == 6 || isFast) added->Args({n, height});
    added->Unit(benchmark::kMillisecond)->MinTime(0.1);
}

}  // namespace

int main(int argc, char** argv) {
    for (auto model : {MobilityForce::ForceCoupling, MobilityForce::RotnePragerYamakawa})
        for (auto boundary :
             {MobilityForce::NoSlipChannel, MobilityForce::PeriodicWall, MobilityForce::Film}) {
            if (!traitsOf(model).hasBoundary(boundary)) continue;
            const bool sharesNodes = boundary == MobilityForce::Film;  // those of the channel
            for (bool withPlanes : {false, true})
                if (withPlanes || !sharesNodes) {
                    add("product", product, {model, boundary, withPlanes});
                    add("noise", noise, {model, boundary, withPlanes});
                }
            add("noiseByProducts", noiseByProducts, {model, boundary, true});
        }
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}
