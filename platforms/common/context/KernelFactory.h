#ifndef RIGIDHI_KERNEL_FACTORY_H_
#define RIGIDHI_KERNEL_FACTORY_H_

#include <string>

#include "context/RigidBodyKernel.h"

namespace RigidHIPlugin {

/**
 * From now on Contexts on the platform of this name make the integrator's kernel of these parts;
 * nothing if there is no such platform.
 *
 * @param library  in the message about a kernel that the library does not have
 */
void registerKernel(const std::string& platform, const std::string& library,
                    const PlatformParts& parts);

}  // namespace RigidHIPlugin

#endif
