#include <openmm/KernelFactory.h>
#include <openmm/OpenMMException.h>
#include <openmm/PluginInitializer.h>
#include <openmm/internal/ContextImpl.h>

#include "CpuRigidHIKernels.h"

using namespace OpenMM;

namespace RigidHIPlugin {

class CpuRigidHIKernelFactory : public KernelFactory {
public:
    KernelImpl* createKernelImpl(std::string name, const Platform& platform, ContextImpl& context) const override {
        if (name == IntegrateRigidBodiesKernel::Name()) return new CpuIntegrateRigidBodiesKernel(name, platform);
        throw OpenMMException("OpenMMRigidHICPU: tried to create a kernel with unknown name '" + name + "'");
    }
};

}  // namespace RigidHIPlugin

// OpenMM calls these two after it has loaded the library.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        Platform& platform = Platform::getPlatform(i);
        if (platform.getName() == "CPU")
            platform.registerKernelFactory(RigidHIPlugin::IntegrateRigidBodiesKernel::Name(),
                                           new RigidHIPlugin::CpuRigidHIKernelFactory());
    }
}
