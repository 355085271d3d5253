#ifndef RIGIDHI_CPU_GRID_FLUID_H_
#define RIGIDHI_CPU_GRID_FLUID_H_

#include <functional>
#include <memory>
#include <mutex>

#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

struct GridPlane;

/**
 * The same with SIMD and threads.
 *
 * A plane of nodes across x belongs to one thread at a time: particles are spread to it in one order and transformed along z and y while it is in the cache; a
 * row of modes along x is gathered, transformed, solved, transformed back and put back at once; and a plane is averaged over as soon as it is transformed back. So
 * results do not depend on the number of threads. Transforms are FFTW's of one dimension, planned by FFTW_ESTIMATE, which always makes the same plan:
 * out of place along z, in blocks of neighbouring columns along y and x.
 *
 * Cost: three transforms there and three back a product, three back a random field; n P^3 pi/6 nodes each for spreading and averaging, P the stencil's
 * width. Measured: benchmarks/README.md. Memory: three numbers a node, and as many for each random field that is kept.
 */
class CpuGridFluid : public GridFluid {
public:
    /** Calls task(first, end) for ranges that cover 0 ... count - 1, on several threads. */
    typedef std::function<void(int count, const std::function<void(int, int)>& task)> ForRanges;

    explicit CpuGridFluid(ForRanges forRanges = {});
    ~CpuGridFluid() override;

    struct Plans;
    struct Scratch;

protected:
    void multiplyColumn(const GridStencils& stencils, double viscosity, const double* forces,
                        double* velocities) override;
    void drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise, GridField& field) override;
    std::unique_ptr<ModeNoise> modeNoise(const NoiseStream& noise, uint32_t purpose) const override;
    void averageColumn(const GridField& field, const GridStencils& stencils, double* velocities) override;
    void averageGradientColumn(const GridField& field, const GridStencils& stencils, double* gradients) override;

private:
    void prepare(const GridStencils& stencils);
    void release();
    void split(int count, const std::function<void(int, int)>& task) const;
    std::unique_ptr<Scratch> takeScratch();
    void giveBack(std::unique_ptr<Scratch> scratch);
    void transformColumns(double* plane, bool forward, Scratch& scratch) const;
    template <class Action>
    void forColumns(int y, Scratch& scratch, const Action& action) const;
    void solveColumns(int y, double viscosity, Scratch& scratch);
    void drawColumns(int y, double viscosity, const ModeNoise& noise, Scratch& scratch);
    void planeBack(int component, int x, double* nodes, Scratch& scratch);
    void averagePlane(const GridStencils& stencils, int x, const GridPlane& plane);
    void sumParts(const GridStencils& stencils, int particle, int numbers, double* sum) const;
    void sumVelocities(const GridStencils& stencils, double* velocities) const;

    const ForRanges forRanges;
    GridShape shape;
    int rowLength = 0, rowModes = 0;  // numbers of a row of nodes; complex numbers of a row of modes
    std::unique_ptr<Plans> plans;
    AlignedArray modes[3];
    std::vector<double> waveNumbers, keeps;  // along x
    std::vector<int> waveIndices;
    std::mutex scratchMutex;
    std::vector<std::unique_ptr<Scratch>> free;
    std::vector<double> parts;  // of averages, a slice after the other
};

/** CounterModeNoise by packs of modes; the same numbers to a few roundings. */
class SimdModeNoise : public CounterModeNoise {
public:
    using CounterModeNoise::CounterModeNoise;
    void fill(const int* nx, int count, int ny, int nz, std::complex<double>* numbers) const override;
};

}  // namespace RigidHIPlugin

#endif
