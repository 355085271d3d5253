// CustomRigidHIIntegrator on OpenMM's CPU platform. It uses the arrays of the Reference platform,
// and spreads packs of bodies over threads.

#include <openmm/Platform.h>
#include <openmm/internal/ContextImpl.h>

#include "context/Libraries.h"
#include "context/ReferenceArrays.h"
#include "host/ThreadedLoops.h"
#include "kernel/KernelFactory.h"

using namespace RigidHIPlugin;

// OpenMM calls these two functions after it has loaded the library.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    PlatformParts parts;
    parts.arrays = [](OpenMM::ContextImpl& context) {
        return std::make_unique<ReferenceArrays>(context);
    };
    parts.loops = [](OpenMM::ContextImpl& context) {
        const int threads =
            std::stoi(context.getPlatform().getPropertyValue(context.getOwner(), "Threads"));
        return std::make_unique<ThreadedLoops>(threads);
    };
    registerKernel("CPU", "OpenMMRigidHICPU", parts);
}

// openmmrigidhi.describe() in Python calls this function.
extern "C" __attribute__((visibility("default"))) const char* describeRigidHI() {
    static const std::string text = describeLibraries();
    return text.c_str();
}
