#ifndef RIGIDHI_CPU_GRID_FLUID_H_
#define RIGIDHI_CPU_GRID_FLUID_H_

#include <functional>
#include <memory>

#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

template <typename T>
class GridEngine;

/** Calls task(first, end) for ranges that cover 0 ... count - 1, on several threads. */
typedef std::function<void(int count, const std::function<void(int, int)>& task)> GridThreads;

/**
 * The same with SIMD and threads, in double precision, and products in single precision for
 * iterations that can do with them.
 *
 * A slab of planes across x belongs to one thread at a time, with x in the lanes of packs:
 * particles are spread to its rows in one order, a row is transformed along z as soon as no more
 * particles reach it, while it is in the cache, then all along y; columns of modes along x, which
 * lie one after the other, are transformed, solved and transformed back at once; and the way back
 * is the same, with a particle averaged over as soon as its rows are there. So results do not
 * depend on the number of threads. Transforms are FourierPlan's.
 *
 * Cost: three transforms there and three back a product, three back a random field; about n P^3
 * pi/4 nodes each for spreading and averaging, P the stencil's width. Measured:
 * benchmarks/README.md. Memory: three numbers a node, as many for each random field that is kept,
 * and half as many for rough products.
 */
class CpuGridFluid : public GridFluid {
public:
    explicit CpuGridFluid(GridThreads threads = {});
    ~CpuGridFluid() override;
    void forRanges(int count, const std::function<void(int, int)>& task) const override;
    bool hasRoughProducts() const override { return true; }

protected:
    void multiplyColumn(const GridStencils& stencils, double viscosity, const double* forces,
                        double* velocities) override;
    void multiplyColumnRoughly(const GridStencils& stencils, double viscosity, const double* forces,
                               double* velocities) override;
    void drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
                   GridField& field) override;
    std::unique_ptr<ModeNoise> modeNoise(const NoiseStream& noise, uint32_t purpose) const override;
    void averageColumn(const GridField& field, const GridStencils& stencils,
                       double* velocities) override;
    void averageGradientColumn(const GridField& field, const GridStencils& stencils,
                               double* gradients) override;
    void multiplyChannels(const std::vector<GridChannel>& channels, double viscosity, bool roughly,
                          const double* forces, double* velocities) override;
    void drawChannels(const std::vector<GridChannel>& channels, double viscosity,
                      const ModeNoise& noise, std::vector<GridField>& fields) override;

private:
    template <typename T>
    GridEngine<T>& prepare(std::unique_ptr<GridEngine<T> >& engine, const GridStencils& stencils);

    const GridThreads threads;
    std::unique_ptr<GridEngine<double> > exact;
    std::unique_ptr<GridEngine<float> > rough;  // made when first asked for
};

/** CounterModeNoise by packs of modes; the same numbers to a few roundings. */
class SimdModeNoise : public CounterModeNoise {
public:
    using CounterModeNoise::CounterModeNoise;
    void fill(const int* nx, int count, int ny, int nz,
              std::complex<double>* numbers) const override;
};

}  // namespace RigidHIPlugin

#endif
