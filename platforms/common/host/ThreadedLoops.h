#ifndef RIGIDHI_THREADED_LOOPS_H_
#define RIGIDHI_THREADED_LOOPS_H_

#include <openmm/internal/ThreadPool.h>

#include <vector>

#include "host/PlatformLoops.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"

namespace RigidHIPlugin {

class GridFluid;

/** Loops over SIMD packs of bodies, spread over threads of their own. */
class ThreadedLoops : public PlatformLoops {
public:
    explicit ThreadedLoops(int threads) : pool(threads), results(pool.getNumThreads()) {}
    LoopResult run(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                   const ParticleArrays& arrays) override;
    void fillNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                   double* xi) override;
    void forRanges(int count, const std::function<void(int, int)>& task) override;
    void forTasks(int count, const std::function<void(int)>& task) override;
    std::unique_ptr<MobilityModel> createMobility(const MobilityForce& force,
                                                  const MobilityScene& scene,
                                                  const HydrodynamicParticles& particles,
                                                  bool mayUseThreads) override;
    std::string describe() const override;

protected:
    /** The model of RotnePragerYamakawa, unbounded or above a wall. */
    virtual std::unique_ptr<MobilityModel> createRotnePragerYamakawa(
        const HydrodynamicParticles& particles, double viscosity,
        const CpuRotnePragerYamakawa::ForRanges& threads, const std::optional<NoSlipPlane>& wall,
        bool fastSums);

private:
    template <class Task>
    void split(int count, int minimum, Task task);
    // shared by models while any exist: with threads; for groups that are spread over threads
    std::weak_ptr<GridFluid> gridFluid, gridFluidOfOne;
    OpenMM::ThreadPool pool;
    std::vector<LoopResult> results;  // of a loop's threads
};

}  // namespace RigidHIPlugin

#endif
