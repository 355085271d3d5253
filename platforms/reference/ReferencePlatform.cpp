// CustomRigidHIIntegrator on OpenMM's Reference platform. It uses the platform's own arrays, and
// moves one body after the other.

#include "context/ReferenceArrays.h"
#include "host/ScalarLoops.h"
#include "kernel/KernelFactory.h"

using namespace RigidHIPlugin;

// OpenMM calls these two functions after it has loaded the library.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    PlatformParts parts;
    parts.arrays = [](OpenMM::ContextImpl& context) {
        return std::make_unique<ReferenceArrays>(context);
    };
    parts.loops = [](OpenMM::ContextImpl&) { return std::make_unique<ScalarLoops>(); };
    registerKernel("Reference", "OpenMMRigidHIReference", parts);
}
