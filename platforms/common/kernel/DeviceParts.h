#ifndef RIGIDHI_DEVICE_PARTS_H_
#define RIGIDHI_DEVICE_PARTS_H_

#include "kernel/RigidBodyKernel.h"

namespace RigidHIPlugin {

/**
 * The parts of the kernel on platforms that keep particles on a device (OpenCL, CUDA, HIP): forces
 * are computed there, and bodies are moved on the host. Arrays go through OpenMM's own kernels, and
 * packs of bodies are spread over threads.
 */
PlatformParts partsOfDevicePlatforms();

/**
 * The threads of the host there: the number that the integrator was given, or else that of OpenMM's
 * CPU platform, OPENMM_CPU_THREADS. 0: as many as there are processors.
 */
int numHostThreads(OpenMM::ContextImpl& context);

}  // namespace RigidHIPlugin

#endif
