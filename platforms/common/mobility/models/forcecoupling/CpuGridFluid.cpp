// Products and fields: the order in which slabs and columns of a grid pass through their steps.

#include "mobility/models/forcecoupling/CpuGridFluid.h"

#include <algorithm>

#include "mobility/models/forcecoupling/GridKernels.h"
#include "mobility/models/forcecoupling/GridPlanes.h"
#include "mobility/models/forcecoupling/GridWalls.h"

namespace RigidHIPlugin {

/**
 * Plans and memory for grids of one size, in one precision.
 *
 * Products and fields are those of channels. Particles with their own envelopes are one channel
 * without factors.
 */
template <typename T>
class GridEngine {
public:
    GridEngine(const GridThreads& threads, GridSeconds& seconds)
        : threads(threads), seconds(seconds) {}
    void prepare(const GridStencils& stencils);
    void multiply(const GridChannel* channels, int count, double viscosity, const double* forces,
                  double* velocities);
    void draw(const GridChannel* channels, int count, double viscosity, const ModeNoise& noise,
              GridField* fields);
    void average(const GridField& field, const GridStencils& stencils, bool gradients,
                 double* results);

private:
    using Scratch = GridScratch<T>;
    GridWork<T> work() const;
    void prepare(const GridChannel* channels, int count);
    /** Call task(i, scratch) for i = 0 ... count - 1. Each range of i has its own scratch. */
    template <class Task>
    void forEach(int count, const Task& task);
    /** The number of pairs of rows y and -y of modes. */
    int pairsOfRows() const { return layout.numRows / 2 + 1; }
    void resize(GridField& field) const;
    GridSlab<double> nodesOf(const GridField& field, int slab) const;
    void sumAverages(const GridStencils& stencils, bool gradients, double* results);

    const GridThreads& threads;
    GridSeconds& seconds;
    GridLayout layout;
    GridPlans<T> plans[3];
    AlignedArrayOf<T> waveNumbers, keeps, halfTurns;  // GridWork
    std::vector<int> waveIndices;
    std::vector<ChannelWork<T>> parts;                    // of the present product or field
    std::vector<std::array<AlignedArrayOf<T>, 3>> modes;  // of channels
    std::vector<double> averages;                         // one slice after the other
    std::mutex scratchMutex;
    std::vector<std::unique_ptr<Scratch>> free;
};

template <typename T>
void GridEngine<T>::multiply(const GridChannel* channels, int count, double viscosity,
                             const double* forces, double* velocities) {
    prepare(channels, count);
    const GridWork<T> work = this->work();
    const GridKernels<T>& kernels = GridKernels<T>::best();
    for (const ChannelWork<T>& channel : parts) {
        forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
            const GridSlab<T> nodes = scratch.nodes(layout);
            kernels.spread(work, *channel.stencils, slab, channel.ofDipoles, forces, nodes,
                           scratch);
            kernels.transform(work, channel.modes, slab, nodes, scratch);
        });
        forces += channel.numRows;
    }
    if (layout.shape.planes)
        forEach(pairsOfRows(), [&](int y, Scratch& scratch) {
            kernels.solveBetween(work, parts[0], y, viscosity, scratch);
        });
    else if (layout.shape.walls)
        forEach(pairsOfRows(), [&](int y, Scratch& scratch) {
            kernels.solveBeside(work, parts.data(), count, y, viscosity, scratch);
        });
    else
        forEach(layout.numRows, [&](int y, Scratch& scratch) {
            kernels.solve(work, parts.data(), count, y, viscosity, scratch);
        });
    for (const ChannelWork<T>& channel : parts) {
        averages.resize(numbersOfPart * (size_t)channel.stencils->numSlices());
        forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
            const GridSlab<T> nodes = scratch.nodes(layout);
            kernels.transformBack(work, channel.modes, slab, nodes, scratch);
            kernels.average(work, *channel.stencils, slab, channel.ofDipoles, nodes,
                            averages.data(), scratch);
        });
        sumAverages(*channel.stencils, channel.ofDipoles, velocities);
        velocities += channel.numRows;
    }
}

template <typename T>
void GridEngine<T>::draw(const GridChannel* channels, int count, double viscosity,
                         const ModeNoise& noise, GridField* fields) {
    prepare(channels, count);
    const GridWork<T> work = this->work();
    const GridKernels<T>& kernels = GridKernels<T>::best();
    const FieldKernels& kernelsOfFields = FieldKernels::best();
    if (layout.shape.planes) {
        layout.shape.planes->prepareFields();
        forEach(pairsOfRows(), [&](int y, Scratch& scratch) {
            kernelsOfFields.drawBetween(work, parts[0], y, viscosity, noise, scratch);
        });
    } else if (layout.shape.walls) {
        layout.shape.walls->getFields();  // make them once, before threads need them
        forEach(pairsOfRows(), [&](int y, Scratch& scratch) {
            kernelsOfFields.drawBeside(work, parts.data(), count, y, viscosity, noise, scratch);
        });
    } else
        forEach(layout.numRows, [&](int y, Scratch& scratch) {
            kernelsOfFields.draw(work, parts.data(), count, y, viscosity, noise, scratch);
        });
    for (const ChannelWork<T>& channel : parts) {
        GridField& field = *fields++;
        resize(field);
        forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
            const GridSlab<T> nodes = nodesOf(field, slab);
            kernels.transformBack(work, channel.modes, slab, nodes, scratch);
            kernelsOfFields.fill(work, nodes, scratch);
        });
    }
}

template <typename T>
void GridEngine<T>::average(const GridField& field, const GridStencils& stencils, bool gradients,
                            double* results) {
    prepare(stencils);
    const GridWork<T> work = this->work();
    const FieldKernels& kernelsOfFields = FieldKernels::best();
    averages.resize(numbersOfPart * (size_t)stencils.numSlices());
    forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
        kernelsOfFields.average(work, stencils, slab, nodesOf(field, slab), gradients,
                                averages.data(), scratch);
    });
    sumAverages(stencils, gradients, results);
}

template <typename T>
void GridEngine<T>::prepare(const GridStencils& stencils) {
    const GridLayout wanted(stencils);
    const std::array<int, 3>& n = wanted.shape.size;
    const bool same = layout.shape.size == n && layout.rowLength == wanted.rowLength &&
                      layout.numRows == wanted.numRows && layout.reach == wanted.reach;
    layout = wanted;
    const size_t column = layout.columnNumbers();
    waveNumbers.resize(column);
    keeps.resize(column);
    std::fill_n(waveNumbers.data(), column, T(0));
    std::fill_n(keeps.data(), column, T(0));
    waveIndices.resize(n[0]);
    for (int x = 0; x < n[0]; x++) {
        for (int part = 0; part < 2; part++) {
            waveNumbers[2 * x + part] = static_cast<T>(layout.shape.waveNumber(0, x));
            keeps[2 * x + part] = static_cast<T>(!layout.shape.isNyquist(0, x));
        }
        waveIndices[x] = layout.shape.waveIndex(0, x);
    }
    if (same) return;
    free.clear();
    modes.clear();
    // One column along x; all planes of a slab along y; pairs of planes along z.
    const int atOnce[3] = {1, slabWidth, slabWidth / 2}, lengths[3] = {n[0], layout.numRows, n[2]};
    for (int axis = 0; axis < 3; axis++) {
        plans[axis].there = FourierPlan<T>(lengths[axis], atOnce[axis], false);
        plans[axis].back = FourierPlan<T>(lengths[axis], atOnce[axis], true);
    }
    halfTurns.resize(2 * layout.numRows);
    for (int m = 0; m < layout.numRows; m++) {
        halfTurns[2 * m] = static_cast<T>(std::cos(M_PI * m / (2 * layout.numRows)));
        halfTurns[2 * m + 1] = static_cast<T>(std::sin(M_PI * m / (2 * layout.numRows)));
    }
}

template <typename T>
void GridEngine<T>::prepare(const GridChannel* channels, int count) {
    prepare(*channels[0].stencils);
    while (static_cast<int>(modes.size()) < count) {
        modes.emplace_back();
        for (AlignedArrayOf<T>& component : modes.back()) component.resize(layout.modeNumbers());
    }
    parts.clear();
    for (int g = 0; g < count; g++)
        parts.push_back({channels[g].stencils,
                         channels[g].factors,
                         channels[g].ofTorques,
                         channels[g].faxen,
                         channels[g].ofDipoles,
                         channels[g].numRows(),
                         {modes[g][0].data(), modes[g][1].data(), modes[g][2].data()}});
}

template <typename T>
GridWork<T> GridEngine<T>::work() const {
    // A grid with more bytes than this does not stay in caches from one pass to the next.
    const double cached = 16e6;
    return {layout,
            plans,
            waveNumbers.data(),
            keeps.data(),
            waveIndices.data(),
            halfTurns.data(),
            3.0 * sizeof(T) * layout.modeNumbers() > cached};
}

template <typename T>
template <class Task>
void GridEngine<T>::forEach(int count, const Task& task) {
    const std::function<void(int, int)> range = [&](int first, int end) {
        std::unique_ptr<Scratch> scratch;
        {
            const std::lock_guard<std::mutex> lock(scratchMutex);
            if (!free.empty()) {
                scratch = std::move(free.back());
                free.pop_back();
            }
        }
        if (!scratch) {
            scratch = std::make_unique<Scratch>();
            const size_t alongY = (size_t)modesAtOnce * modeWidth * layout.numRows,
                         alongZ = (size_t)slabWidth * layout.shape.size[2];
            scratch->slab.resize(3 * layout.slabNumbers());
            scratch->columns.resize(std::max({3 * layout.columnNumbers(), alongY, alongZ}));
            scratch->transformed.resize(alongY);
        }
        for (int i = first; i < end; i++) task(i, *scratch);
        const std::lock_guard<std::mutex> lock(scratchMutex);
        seconds.add(scratch->seconds);
        scratch->seconds = {};
        free.push_back(std::move(scratch));
    };
    if (threads)
        threads(count, range);
    else
        range(0, count);
}

template <typename T>
void GridEngine<T>::resize(GridField& field) const {
    field.shape = layout.shape;
    field.rowLength = layout.rowLength;
    for (AlignedArray& component : field.values)
        component.resize(layout.numSlabs * layout.slabNumbers());
}

template <typename T>
GridSlab<double> GridEngine<T>::nodesOf(const GridField& field, int slab) const {
    GridSlab<double> nodes;
    // Averaging only reads.
    for (int c = 0; c < 3; c++)
        nodes.values[c] = const_cast<double*>(field.values[c].data()) + slab * layout.slabNumbers();
    return nodes;
}

/** Sum a particle's slices in their order, whichever thread averaged over them. */
template <typename T>
void GridEngine<T>::sumAverages(const GridStencils& stencils, bool gradients, double* results) {
    const HydrodynamicParticles& particles = stencils.getParticles();
    forEach(particles.size(), [&](int p, Scratch&) {
        const int numbers = gradients ? 9 : particles.hasTorque[p] ? 6 : 3;
        double* sum = results + (gradients ? 9 * (size_t)p : particles.firstRow[p]);
        std::fill(sum, sum + numbers, 0.0);
        const GridStencils::Range own = stencils.slicesOf(p);
        for (int i = own.begin; i < own.end; i++) {
            const double* part = &averages[numbersOfPart * (size_t)stencils.sliceNumber(i)];
            for (int c = 0; c < numbers; c++) sum[c] += part[c];
        }
    });
}

void SimdModeNoise::fill(const int* nx, int count, int ny, int nz,
                         std::complex<double>* numbers) const {
    FieldKernels::best().fillModes(noise, purpose, nx, count, ny, nz, false, numbers);
}

void SimdModeNoise::fillPlane(const int* nx, int count, int ny, int j,
                              std::complex<double>* numbers) const {
    FieldKernels::best().fillModes(noise, purpose, nx, count, ny, modeOfPlane(j), true, numbers);
}

CpuGridFluid::CpuGridFluid(GridThreads threads) : threads(std::move(threads)) {}

CpuGridFluid::~CpuGridFluid() {}

std::unique_ptr<ModeNoise> CpuGridFluid::modeNoise(const NoiseStream& noise,
                                                   uint32_t purpose) const {
    return std::make_unique<SimdModeNoise>(noise, purpose);
}

namespace {

/** Particles with their own envelopes, as a channel for GridEngine. */
GridChannel withoutFactors(const GridStencils& stencils) { return {&stencils, nullptr, false}; }

}  // namespace

template <typename T>
GridEngine<T>& CpuGridFluid::engineOf(std::unique_ptr<GridEngine<T>>& engine,
                                      const GridStencils& stencils, int channels) {
    if (!engine) engine = std::make_unique<GridEngine<T>>(threads, seconds);
    held = channels * memory(stencils.getShape());
    return *engine;
}

void CpuGridFluid::multiplyColumn(const GridStencils& stencils, double viscosity,
                                  const double* forces, double* velocities) {
    const GridChannel all = withoutFactors(stencils);
    engineOf(exact, stencils).multiply(&all, 1, viscosity, forces, velocities);
}

void CpuGridFluid::multiplyColumnInSingle(const GridStencils& stencils, double viscosity,
                                          const double* forces, double* velocities) {
    const GridChannel all = withoutFactors(stencils);
    engineOf(single, stencils).multiply(&all, 1, viscosity, forces, velocities);
}

void CpuGridFluid::multiplyChannels(const std::vector<GridChannel>& channels, double viscosity,
                                    bool inSingle, const double* forces, double* velocities) {
    const GridStencils& stencils = *channels[0].stencils;
    const int count = channels.size();
    if (inSingle)
        engineOf(single, stencils, count)
            .multiply(channels.data(), count, viscosity, forces, velocities);
    else
        engineOf(exact, stencils, count)
            .multiply(channels.data(), count, viscosity, forces, velocities);
}

void CpuGridFluid::drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
                             GridField& field) {
    const GridChannel all = withoutFactors(stencils);
    engineOf(exact, stencils).draw(&all, 1, viscosity, noise, &field);
}

void CpuGridFluid::drawChannels(const std::vector<GridChannel>& channels, double viscosity,
                                const ModeNoise& noise, std::vector<GridField>& fields) {
    engineOf(exact, *channels[0].stencils)
        .draw(channels.data(), channels.size(), viscosity, noise, fields.data());
}

void CpuGridFluid::averageColumn(const GridField& field, const GridStencils& stencils,
                                 double* velocities) {
    engineOf(exact, stencils).average(field, stencils, false, velocities);
}

void CpuGridFluid::averageGradientColumn(const GridField& field, const GridStencils& stencils,
                                         double* gradients) {
    engineOf(exact, stencils).average(field, stencils, true, gradients);
}

void CpuGridFluid::forRanges(int count, const std::function<void(int, int)>& task) const {
    if (threads)
        threads(count, task);
    else
        task(0, count);
}

}  // namespace RigidHIPlugin
