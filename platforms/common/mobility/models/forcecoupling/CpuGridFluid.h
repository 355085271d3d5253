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
 * A GridFluid with SIMD and threads, in double precision. Iterations that need no more accuracy
 * take products in single precision.
 *
 * A slab of planes normal to x belongs to one thread at a time, with x in the lanes of packs.
 * Particles spread to the rows of a slab in a fixed order. As soon as no more particles reach a
 * row, while the row is still in the cache, it is transformed along z; then all rows are
 * transformed along y. Columns of modes along x are contiguous: each is transformed, solved and
 * transformed back in one pass. The way back mirrors these steps, and the average for a particle is
 * taken as soon as its rows are ready. So results do not depend on the number of threads. The
 * transforms are those of FourierPlan. GridKernels has the steps, and GridEngine their order.
 *
 * Cost: a product takes three forward and three backward transforms, and a random field takes three
 * backward ones. Spreading and averaging take about n P^3 pi/4 nodes each, with P the stencil's
 * width. Measurements: benchmarks/README.md. Memory: three numbers for each node, as many for each
 * stored random field, and half as many for products in single precision.
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
    /** The engine for that many channels, made on first use. */
    template <typename T>
    GridEngine<T>& engineOf(std::unique_ptr<GridEngine<T>>& engine, const GridStencils& stencils,
                            int channels = 1);

    const GridThreads threads;
    std::unique_ptr<GridEngine<double>> exact;
    std::unique_ptr<GridEngine<float>> single;
};

/** CounterModeNoise for packs of modes. The numbers agree to a few rounding errors. */
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
