#ifndef RIGIDHI_LIBRARIES_H_
#define RIGIDHI_LIBRARIES_H_

#include <string>

namespace RigidHIPlugin {

/**
 * The instruction set that packs use on this machine, the compiler, and the libraries that the
 * numerics use, with their versions.
 */
std::string describeLibraries();

/**
 * What to do where OpenBLAS does not know the processor and takes old kernels; empty where it takes
 * good ones.
 */
std::string adviceOnLinearAlgebra();

}  // namespace RigidHIPlugin

#endif
