#ifndef RIGIDHI_KERNEL_FACTORY_H_
#define RIGIDHI_KERNEL_FACTORY_H_

#include <string>

#include "kernel/RigidBodyKernel.h"

namespace RigidHIPlugin {

/**
 * Register the integrator's kernel, made of these parts, for Contexts on the platform of this name.
 * Does nothing without such a platform. If the library does not fit the loaded ones, the creation
 * of such a Context fails, with the reason and the remedy (versionConflict()).
 *
 * @param library  name of the library, for error messages
 */
void registerKernel(const std::string& platform, const std::string& library,
                    const PlatformParts& parts);

/** Likewise for a library that was compiled for this version of OpenMM. */
void registerKernel(const std::string& platform, const std::string& library,
                    const PlatformParts& parts, const std::string& openMMVersion);

}  // namespace RigidHIPlugin

#endif
