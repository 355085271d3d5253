#ifndef RIGIDHI_PLATFORM_LOOPS_H_
#define RIGIDHI_PLATFORM_LOOPS_H_

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "host/StepSettings.h"
#include "mobility/MobilityModel.h"
#include "openmmrigidhi/MobilityForce.h"
#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

struct MobilityScene;

/** The loops: the part of a step that differs between platforms. */
class PlatformLoops {
public:
    virtual ~PlatformLoops() {}
    /** Run a loop over all bodies. The result does not depend on how the platform divides the work.
     */
    virtual LoopResult run(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                           const ParticleArrays& arrays) = 0;
    /** Fill xi with noise for free particles, 3 numbers for each. */
    virtual void fillNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                           double* xi) = 0;
    /** Call task(first, end) over ranges that cover 0 ... count - 1; ranges may run at the same
     * time. */
    virtual void forRanges(int count, const std::function<void(int, int)>& task) = 0;
    /**
     * Call task(i) for i = 0 ... count - 1. Each task is large enough for a thread of its own, and
     * several may run at the same time.
     */
    virtual void forTasks(int count, const std::function<void(int)>& task) = 0;
    /**
     * The model of a MobilityForce, with its boundary, for particles that feel each other.
     *
     * @param mayUseThreads  false for models that tasks of forTasks() use
     */
    virtual std::unique_ptr<MobilityModel> createMobility(const MobilityForce& force,
                                                          const MobilityScene& scene,
                                                          const HydrodynamicParticles& particles,
                                                          bool mayUseThreads) = 0;
    /** How the loops run, for describeEffects(). */
    virtual std::string describe() const = 0;
    /**
     * Whether the platform's device makes products with mobilities, and which ones or why not, for
     * describeEffects().
     */
    virtual std::pair<bool, std::string> describeProducts() const {
        return {false, "the host makes all products: the platform has no device for them"};
    }
};

}  // namespace RigidHIPlugin

#endif
