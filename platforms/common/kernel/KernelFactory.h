#ifndef RIGIDHI_KERNEL_FACTORY_H_
#define RIGIDHI_KERNEL_FACTORY_H_

#include <string>

#include "kernel/RigidBodyKernel.h"

namespace RigidHIPlugin {

/**
 * Register the integrator's kernel, made of these parts, for Contexts on the platform of this name.
 * Does nothing without such a platform.
 *
 * @param library  name of the library, for error messages
 */
void registerKernel(const std::string& platform, const std::string& library,
                    const PlatformParts& parts);

}  // namespace RigidHIPlugin

#endif
