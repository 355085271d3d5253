#ifndef RIGIDHI_DEVICE_PLATFORM_H_
#define RIGIDHI_DEVICE_PLATFORM_H_

#include <openmm/internal/ContextImpl.h>

#include <memory>
#include <string>

#include "DeviceLoops.h"
#include "DeviceSteps.h"
#include "kernel/DeviceParts.h"
#include "kernel/KernelFactory.h"

namespace RigidHIPlugin {

/**
 * Register the integrator's kernel for one of OpenMM's platforms with devices.
 *
 * @tparam Platform  OpenMM's class. These platforms differ only in the class of their platform
 *     data.
 * @tparam Kind      Device, or a class of tests that is derived from it
 */
template <class Platform, class Kind = Device>
void registerDevicePlatform(const std::string& name) {
    const auto deviceOf = [](OpenMM::ContextImpl& context) {
        return std::make_unique<const Kind>(
            *static_cast<typename Platform::PlatformData*>(context.getPlatformData())->contexts[0]);
    };
    PlatformParts parts = partsOfDevicePlatforms();
    parts.loops = [=](OpenMM::ContextImpl& context) {
        return std::make_unique<DeviceLoops>(numHostThreads(context), deviceOf(context), name);
    };
    parts.native = [=](OpenMM::ContextImpl& context, Scene& scene, ContextMirror& mirror,
                       Stepper& stepper) {
        return std::make_unique<DeviceSteps>(deviceOf(context), context, scene, mirror, stepper);
    };
    registerKernel(name, "OpenMMRigidHI" + name, parts);
}

}  // namespace RigidHIPlugin

#endif
