#ifndef RIGIDHI_LIBRARIES_H_
#define RIGIDHI_LIBRARIES_H_

#include <string>

namespace RigidHIPlugin {

/**
 * The instruction set that packs use on this machine, the compiler, and the libraries that the
 * numerics use, with their versions.
 */
std::string describeLibraries();

}  // namespace RigidHIPlugin

#endif
