// CustomRigidHIIntegrator on OpenMM's OpenCL platform: bodies move on the device, by
// platforms/device.

#include <openmm/opencl/OpenCLContext.h>
#include <openmm/opencl/OpenCLPlatform.h>

#include "DevicePlatform.h"

// OpenMM calls these two functions after it has loaded the library.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    RigidHIPlugin::registerDevicePlatform<OpenMM::OpenCLPlatform>("OpenCL");
}
