// CustomRigidHIIntegrator on every other platform of OpenMM (OpenCL, CUDA, HIP). Forces are
// computed there, and bodies on the host. Arrays go through OpenMM's own kernels, and packs of
// bodies are spread over threads.

#include <openmm/Platform.h>
#include <openmm/internal/ContextImpl.h>
#include <openmm/kernels.h>

#include <cstdlib>
#include <sstream>

#include "context/KernelArrays.h"
#include "host/ThreadedLoops.h"
#include "kernel/KernelFactory.h"

using namespace OpenMM;
using namespace RigidHIPlugin;

namespace {

/**
 * The number that the integrator was given, or else that of OpenMM's CPU platform:
 * OPENMM_CPU_THREADS, or as many as there are processors.
 */
int hostThreads(ContextImpl& context) {
    const auto& integrator = dynamic_cast<const CustomRigidHIIntegrator&>(context.getIntegrator());
    int threads = integrator.getNumHostThreads();
    if (threads == 0)
        if (const char* wanted = std::getenv("OPENMM_CPU_THREADS"))
            std::stringstream(wanted) >> threads;
    return threads;  // 0: as many as processors
}

}  // namespace

// OpenMM calls these two functions after it has loaded the library, and again if it is told to load
// it again.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    PlatformParts parts;
    parts.arrays = [](ContextImpl& context) { return std::make_unique<KernelArrays>(context); };
    parts.loops = [](ContextImpl& context) {
        return std::make_unique<ThreadedLoops>(hostThreads(context));
    };
    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        const Platform& platform = Platform::getPlatform(i);
        const std::string& name = platform.getName();
        if (name == "Reference" || name == "CPU") continue;  // they have libraries of their own
        const bool isServed = platform.supportsKernels({IntegrateRigidBodiesKernel::Name()}),
                   canServe = platform.supportsKernels(
                       {UpdateStateDataKernel::Name(), IntegrateVerletStepKernel::Name()});
        if (canServe && !isServed) registerKernel(name, "OpenMMRigidHIAny", parts);
    }
}
