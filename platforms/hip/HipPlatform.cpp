// CustomRigidHIIntegrator on OpenMM's HIP platform: bodies move on the device, by
// platforms/device.

#include <openmm/hip/HipContext.h>
#include <openmm/hip/HipPlatform.h>

#include "DevicePlatform.h"

// OpenMM calls these two functions after it has loaded the library.
extern "C" __attribute__((visibility("default"))) void registerPlatforms() {}

extern "C" __attribute__((visibility("default"))) void registerKernelFactories() {
    RigidHIPlugin::registerDevicePlatform<OpenMM::HipPlatform>("HIP");
}
