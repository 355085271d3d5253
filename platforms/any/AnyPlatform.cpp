// CustomRigidHIIntegrator on every other platform of OpenMM (OpenCL, CUDA, HIP) for which no
// library of this plugin has kernels. The platform computes forces, and the host moves bodies.

#include <openmm/Platform.h>
#include <openmm/kernels.h>

#include "kernel/DeviceParts.h"
#include "kernel/KernelFactory.h"

using namespace OpenMM;
using namespace RigidHIPlugin;

// OpenMM calls these two functions after it has loaded the library, and again whenever it is asked
// to load the library again.
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
