#include "kernel/DeviceParts.h"

#include <openmm/internal/ContextImpl.h>

#include <cstdlib>
#include <sstream>

#include "context/KernelArrays.h"
#include "host/ThreadedLoops.h"

using namespace OpenMM;

namespace RigidHIPlugin {

int numHostThreads(ContextImpl& context) {
    const auto& integrator = dynamic_cast<const CustomRigidHIIntegrator&>(context.getIntegrator());
    int threads = integrator.getNumHostThreads();
    if (threads == 0)
        if (const char* wanted = std::getenv("OPENMM_CPU_THREADS"))
            std::stringstream(wanted) >> threads;
    return threads;
}

PlatformParts partsOfDevicePlatforms() {
    PlatformParts parts;
    parts.arrays = [](ContextImpl& context) { return std::make_unique<KernelArrays>(context); };
    parts.loops = [](ContextImpl& context) {
        return std::make_unique<ThreadedLoops>(numHostThreads(context));
    };
    return parts;
}

}  // namespace RigidHIPlugin
