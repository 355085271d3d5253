#include "ReferenceRigidHIKernels.h"

#include "context/ReferenceArrays.h"
#include "engine/BodyLoops-inl.h"
#include "mobility/Models.h"

using namespace OpenMM;

namespace RigidHIPlugin {

namespace {

/** One thread, one body after the other. */
class ReferenceLoops : public PlatformLoops {
public:
    LoopResult run(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                   const ParticleArrays& arrays) override {
        return scalar::runBodyLoop<double>(loop, bodies, settings, arrays, 0, bodies.getNumBlocks());
    }
    void fillNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count, double* xi) override {
        scalar::fillNoise<double>(noise, purpose, index, count, xi);
    }
    void forRanges(int count, const std::function<void(int, int)>& task) override { task(0, count); }
    void forTasks(int count, const std::function<void(int)>& task) override {
        for (int i = 0; i < count; i++) task(i);
    }
    std::unique_ptr<MobilityModel> createMobility(const MobilityForce& force, bool crossingAllowed,
                                                  const HydrodynamicParticles& particles, bool) override {
        return RigidHIPlugin::createMobility(force, crossingAllowed, particles);
    }
    std::string describe() const override { return "Reference: one thread, one body at a time"; }
};

}  // namespace

std::unique_ptr<ContextArrays> ReferenceIntegrateRigidBodiesKernel::createArrays(ContextImpl& context) {
    return std::unique_ptr<ContextArrays>(new ReferenceArrays(context));
}

std::unique_ptr<PlatformLoops> ReferenceIntegrateRigidBodiesKernel::createLoops(ContextImpl& context) {
    return std::unique_ptr<PlatformLoops>(new ReferenceLoops());
}

}  // namespace RigidHIPlugin
