#ifndef RIGIDHI_CPU_GRID_FLUID_H_
#define RIGIDHI_CPU_GRID_FLUID_H_

#include <functional>
#include <memory>

#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

template <typename T>
class GridEngine;

/** Calls task(first, end) for ranges that cover 0 ... count - 1, on several threads. */
using GridThreads = std::function<void(int count, const std::function<void(int, int)>& task)>;

/**
 * A GridFluid with SIMD and threads, in double precision. Products are in single precision for
 * iterations for which it is accurate enough.
 *
 * A slab of planes across x belongs to one thread at a time, with x in the lanes of packs.
 * Particles are spread to the rows of a slab in one order. A row is transformed along z as soon as
 * no more particles reach it, while it is in the cache, and all rows are then transformed along y.
 * Columns of modes along x, which lie one after the other, are transformed, solved and transformed
 * back at once. The way back is the same, and a particle is averaged over as soon as its rows are
 * there. So results do not depend on the number of threads. The transforms are those of
 * FourierPlan. GridKernels are the steps, and GridEngine has their order.
 *
 * Cost: a product takes three transforms there and three back, and a random field takes three back.
 * Spreading and averaging take about n P^3 pi/4 nodes each, with P the stencil's width.
 * Measurements: benchmarks/README.md. Memory: three numbers a node, as many for each random field
 * that is kept, and half as many for products in single precision.
 */
class CpuGridFluid : public GridFluid {
public:
    explicit CpuGridFluid(GridThreads threads = {});
    ~CpuGridFluid() override;
    void forRanges(int count, const std::function<void(int, int)>& task) const override;
    bool hasSinglePrecision() const override { return true; }

protected:
    void multiplyColumn(const GridStencils& stencils, double viscosity, const double* forces,
                        double* velocities) override;
    void multiplyColumnInSingle(const GridStencils& stencils, double viscosity,
                                const double* forces, double* velocities) override;
    void drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
                   GridField& field) override;
    std::unique_ptr<ModeNoise> modeNoise(const NoiseStream& noise, uint32_t purpose) const override;
    void averageColumn(const GridField& field, const GridStencils& stencils,
                       double* velocities) override;
    void averageGradientColumn(const GridField& field, const GridStencils& stencils,
                               double* gradients) override;
    void multiplyChannels(const std::vector<GridChannel>& channels, double viscosity, bool inSingle,
                          const double* forces, double* velocities) override;
    void drawChannels(const std::vector<GridChannel>& channels, double viscosity,
                      const ModeNoise& noise, std::vector<GridField>& fields) override;

private:
    /** The engine, which is made when it is first used, for that many channels. */
    template <typename T>
    GridEngine<T>& engineOf(std::unique_ptr<GridEngine<T>>& engine, const GridStencils& stencils,
                            int channels = 1);

    const GridThreads threads;
    std::unique_ptr<GridEngine<double>> exact;
    std::unique_ptr<GridEngine<float>> single;
};

/** CounterModeNoise by packs of modes. The numbers are the same to a few roundings. */
class SimdModeNoise : public CounterModeNoise {
public:
    using CounterModeNoise::CounterModeNoise;
    void fill(const int* nx, int count, int ny, int nz,
              std::complex<double>* numbers) const override;
    void fillPlane(const int* nx, int count, int ny, int j,
                   std::complex<double>* numbers) const override;
};

}  // namespace RigidHIPlugin

#endif
