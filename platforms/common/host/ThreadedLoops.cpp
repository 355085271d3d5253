#include "host/ThreadedLoops.h"

#include <algorithm>
#include <exception>
#include <string>
#include <vector>

#include "host/SimdBodyLoops.h"
#include "mobility/Models.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"

using namespace OpenMM;

namespace RigidHIPlugin {

// Waking a sleeping thread takes 10 to 90 microseconds (benchmarks/README.md). A block of bodies
// takes half a microsecond a loop, a free particle ten nanoseconds a move.
static const int minimumBlocksPerThread = 128, minimumParticlesPerThread = 4096;

/** A task computes every element by itself, so that results do not depend on the division. */
template <class Task>
void ThreadedLoops::split(int count, int minimum, Task task) {
    const int parts = std::max(1, std::min(pool.getNumThreads(), count / minimum));
    if (parts == 1) {
        task(0, count, 0);
        return;
    }
    // An exception must not leave a thread of the pool. The caller gets the exception of the first
    // part that threw.
    std::vector<std::exception_ptr> errors(parts);
    pool.execute([&](ThreadPool&, int thread) {
        if (thread >= parts) return;
        try {
            task(static_cast<int>((long long)count * thread / parts),
                 static_cast<int>((long long)count * (thread + 1) / parts), thread);
        } catch (...) {
            errors[thread] = std::current_exception();
        }
    });
    pool.waitForThreads();
    for (const std::exception_ptr& error : errors)
        if (error) std::rethrow_exception(error);
}

LoopResult ThreadedLoops::run(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                              const ParticleArrays& arrays) {
    std::fill(results.begin(), results.end(), LoopResult());
    split(bodies.getNumBlocks(), minimumBlocksPerThread, [&](int first, int end, int thread) {
        results[thread] = runSimdBodyLoop(loop, bodies, settings, arrays, first, end);
    });
    LoopResult all;
    for (const LoopResult& result : results) all.add(result);
    return all;
}

void ThreadedLoops::fillNoise(const NoiseStream& noise, uint32_t purpose, const int* index,
                              int count, double* xi) {
    split(count, minimumParticlesPerThread, [&](int first, int end, int) {
        fillSimdNoise(noise, purpose, index + first, end - first, xi + 3 * first);
    });
}

void ThreadedLoops::forRanges(int count, const std::function<void(int, int)>& task) {
    split(count, minimumParticlesPerThread, [&](int first, int end, int) { task(first, end); });
}

void ThreadedLoops::forTasks(int count, const std::function<void(int)>& task) {
    split(count, 1, [&](int first, int end, int) {
        for (int i = first; i < end; i++) task(i);
    });
}

std::unique_ptr<MobilityModel> ThreadedLoops::createMobility(const MobilityForce& force,
                                                             const MobilityScene& scene,
                                                             const HydrodynamicParticles& particles,
                                                             bool mayUseThreads) {
    CpuRotnePragerYamakawa::ForRanges threads;
    if (mayUseThreads)
        threads = [this](int count, const std::function<void(int, int)>& task) {
            split(count, 1, [&](int first, int end, int) { task(first, end); });
        };
    PlatformModels own;
    own.gridFluid = [&] {
        std::weak_ptr<GridFluid>& shared = mayUseThreads ? gridFluid : gridFluidOfOne;
        std::shared_ptr<GridFluid> fluid = shared.lock();
        if (!fluid) {
            fluid = std::make_shared<CpuGridFluid>(threads);
            shared = fluid;
        }
        return fluid;
    };
    own.rotnePragerYamakawa = [&](const HydrodynamicParticles& seen, double viscosity,
                                  const std::optional<NoSlipPlane>& wall) {
        return createRotnePragerYamakawa(seen, viscosity, threads, wall, force.getFastSummation());
    };
    return RigidHIPlugin::createMobility(force, scene, particles, own);
}

std::unique_ptr<MobilityModel> ThreadedLoops::createRotnePragerYamakawa(
    const HydrodynamicParticles& particles, double viscosity,
    const CpuRotnePragerYamakawa::ForRanges& threads, const std::optional<NoSlipPlane>& wall,
    bool fastSums) {
    return std::make_unique<CpuRotnePragerYamakawa>(particles, viscosity, threads, wall, fastSums);
}

std::string ThreadedLoops::describe() const {
    const int threads = pool.getNumThreads();
    return std::to_string(threads) + (threads == 1 ? " thread, " : " threads, ") +
           std::to_string(simdWidth()) + " bodies at a time (" + simdTargetName() + ")";
}

}  // namespace RigidHIPlugin
