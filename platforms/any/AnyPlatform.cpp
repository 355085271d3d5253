// CustomRigidHIIntegrator on every other platform of OpenMM (OpenCL, CUDA, HIP) for which no
// library of this plugin has kernels. Forces are computed there, and bodies on the host.

#include <openmm/Platform.h>
#include <openmm/kernels.h>

#include "kernel/DeviceParts.h"
#include "kernel/KernelFactory.h"

using namespace OpenMM;
using namespace RigidHIPlugin;

// OpenMM calls these two functions after it has loaded the library, and again if it is told to load
// it again.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        const Platform& platform = Platform::getPlatform(i);
        const std::string& name = platform.getName();
        if (name == "Reference" || name == "CPU") continue;  // they have libraries of their own
        const bool isServed = platform.supportsKernels({IntegrateRigidBodiesKernel::Name()}),
                   canServe = platform.supportsKernels(
                       {UpdateStateDataKernel::Name(), IntegrateVerletStepKernel::Name()});
        if (canServe && !isServed)
            registerKernel(name, "OpenMMRigidHIAny", partsOfDevicePlatforms());
    }
}
