#ifndef RIGIDHI_SCALAR_LOOPS_H_
#define RIGIDHI_SCALAR_LOOPS_H_

#include "host/PlatformLoops.h"

namespace RigidHIPlugin {

class GridFluid;

/** Loops with one thread, one body after the other. */
class ScalarLoops : public PlatformLoops {
public:
    LoopResult run(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                   const ParticleArrays& arrays) override;
    void fillNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                   double* xi) override;
    void forRanges(int count, const std::function<void(int, int)>& task) override {
        task(0, count);
    }
    void forTasks(int count, const std::function<void(int)>& task) override;
    std::unique_ptr<MobilityModel> createMobility(const MobilityForce& force,
                                                  const MobilityScene& scene,
                                                  const HydrodynamicParticles& particles,
                                                  bool mayUseThreads) override;
    std::string describe() const override { return "one thread, one body at a time"; }

private:
    std::weak_ptr<GridFluid> gridFluid;  // shared by models while any exist
};

}  // namespace RigidHIPlugin

#endif
