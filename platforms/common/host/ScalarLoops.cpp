#include "host/ScalarLoops.h"

#include "host/BodyLoops-inl.h"
#include "mobility/Models.h"

namespace RigidHIPlugin {

LoopResult ScalarLoops::run(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                            const ParticleArrays& arrays) {
    return scalar::runBodyLoop<double>(loop, bodies, settings, arrays, 0, bodies.getNumBlocks());
}

void ScalarLoops::fillNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                            double* xi) {
    scalar::fillNoise<double>(noise, purpose, index, count, xi);
}

void ScalarLoops::forTasks(int count, const std::function<void(int)>& task) {
    for (int i = 0; i < count; i++) task(i);
}

std::unique_ptr<MobilityModel> ScalarLoops::createMobility(const MobilityForce& force,
                                                           const MobilityScene& scene,
                                                           const HydrodynamicParticles& particles,
                                                           bool) {
    PlatformModels own;
    own.gridFluid = [&] {
        std::shared_ptr<GridFluid> fluid = gridFluid.lock();
        if (!fluid) {
            fluid = std::make_shared<PlainGridFluid>();
            gridFluid = fluid;
        }
        return fluid;
    };
    return RigidHIPlugin::createMobility(force, scene, particles, own);
}

}  // namespace RigidHIPlugin
