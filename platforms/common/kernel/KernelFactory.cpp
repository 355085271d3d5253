#include "kernel/KernelFactory.h"

#include <openmm/KernelFactory.h>
#include <openmm/OpenMMException.h>
#include <openmm/Platform.h>

#include "openmmrigidhi/Version.h"

using namespace OpenMM;

namespace RigidHIPlugin {

namespace {

class RigidBodyKernelFactory : public KernelFactory {
public:
    RigidBodyKernelFactory(const std::string& library, const std::string& openMMVersion,
                           const PlatformParts& parts)
        : library(library), openMMVersion(openMMVersion), parts(parts) {}
    KernelImpl* createKernelImpl(std::string name, const Platform& platform,
                                 ContextImpl&) const override {
        // Check here, not at the loading of the library: an exception there would end the loading
        // of all of OpenMM.
        const std::string conflict = versionConflict(library, RIGIDHI_VERSION, openMMVersion);
        if (!conflict.empty()) throw OpenMMException(conflict);
        if (name == IntegrateRigidBodiesKernel::Name())
            return new RigidBodyKernel(name, platform, parts);
        throw OpenMMException(library + ": tried to create a kernel with unknown name '" + name +
                              "'");
    }

private:
    const std::string library, openMMVersion;
    const PlatformParts parts;
};

}  // namespace

void registerKernel(const std::string& platformName, const std::string& library,
                    const PlatformParts& parts, const std::string& openMMVersion) {
    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        Platform& platform = Platform::getPlatform(i);
        if (platform.getName() == platformName)
            platform.registerKernelFactory(
                IntegrateRigidBodiesKernel::Name(),
                new RigidBodyKernelFactory(library, openMMVersion, parts));
    }
}

void registerKernel(const std::string& platform, const std::string& library,
                    const PlatformParts& parts) {
    registerKernel(platform, library, parts, RIGIDHI_OPENMM_VERSION);
}

}  // namespace RigidHIPlugin
