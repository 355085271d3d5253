#ifndef RIGIDHI_DEVICE_PARTS_H_
#define RIGIDHI_DEVICE_PARTS_H_

#include "kernel/RigidBodyKernel.h"

namespace RigidHIPlugin {

/**
 * The parts of the kernel on platforms that keep particles on a device (OpenCL, CUDA, HIP). The
 * device computes forces, and the host moves bodies. Arrays go through OpenMM's own kernels, and
 * threads share the packs of bodies.
 */
PlatformParts partsOfDevicePlatforms();

/**
 * The number of threads of the host on these platforms: setNumHostThreads() of the integrator, or
 * else OPENMM_CPU_THREADS, the variable of OpenMM's CPU platform. 0 stands for the number of
 * processors.
 */
int numHostThreads(OpenMM::ContextImpl& context);

}  // namespace RigidHIPlugin

#endif
