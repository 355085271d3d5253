// CustomRigidHIIntegrator on OpenMM's CUDA platform: bodies move on the device, by
// platforms/device.

#include <openmm/cuda/CudaContext.h>
#include <openmm/cuda/CudaPlatform.h>

#include "DevicePlatform.h"

// OpenMM calls these two functions after it has loaded the library.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    RigidHIPlugin::registerDevicePlatform<OpenMM::CudaPlatform>("CUDA");
}
