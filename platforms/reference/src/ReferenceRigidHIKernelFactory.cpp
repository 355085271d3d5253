#include <openmm/KernelFactory.h>
#include <openmm/OpenMMException.h>
#include <openmm/PluginInitializer.h>
#include <openmm/internal/ContextImpl.h>

#include "ReferenceRigidHIKernels.h"

using namespace OpenMM;

namespace RigidHIPlugin {

class ReferenceRigidHIKernelFactory : public KernelFactory {
public:
    KernelImpl* createKernelImpl(std::string name, const Platform& platform, ContextImpl& context) const override {
        if (name == IntegrateRigidBodiesKernel::Name()) return new ReferenceIntegrateRigidBodiesKernel(name, platform);
        throw OpenMMException("OpenMMRigidHIReference: tried to create a kernel with unknown name '" + name + "'");
    }
};

}  // namespace RigidHIPlugin

// OpenMM calls these two after it has loaded the library.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        Platform& platform = Platform::getPlatform(i);
        if (platform.getName() == "Reference")
            platform.registerKernelFactory(RigidHIPlugin::IntegrateRigidBodiesKernel::Name(),
                                           new RigidHIPlugin::ReferenceRigidHIKernelFactory());
    }
}
