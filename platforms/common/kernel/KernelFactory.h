#ifndef RIGIDHI_KERNEL_FACTORY_H_
#define RIGIDHI_KERNEL_FACTORY_H_

#include <string>

#include "kernel/RigidBodyKernel.h"

namespace RigidHIPlugin {

/**
 * Register the integrator's kernel, made of these parts, for Contexts on the platform of this name.
 * Nothing happens if there is no such platform.
 *
 * @param library  in the message about a kernel that the library does not have
 */
void registerKernel(const std::string& platform, const std::string& library,
                    const PlatformParts& parts);

}  // namespace RigidHIPlugin

#endif
