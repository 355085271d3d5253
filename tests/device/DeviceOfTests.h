#ifndef RIGIDHI_DEVICE_OF_TESTS_H_
#define RIGIDHI_DEVICE_OF_TESTS_H_

// OpenMM's class of the platform that a program of device/ tests, and devices that refuse.

#if defined(RIGIDHI_TEST_ON_CUDA)
#include <openmm/cuda/CudaContext.h>
#include <openmm/cuda/CudaPlatform.h>
using DevicePlatform = OpenMM::CudaPlatform;
#elif defined(RIGIDHI_TEST_ON_HIP)
#include <openmm/hip/HipContext.h>
#include <openmm/hip/HipPlatform.h>
using DevicePlatform = OpenMM::HipPlatform;
#else
#include <openmm/opencl/OpenCLContext.h>
#include <openmm/opencl/OpenCLPlatform.h>
using DevicePlatform = OpenMM::OpenCLPlatform;
#endif

#include "Device.h"

namespace RigidHITest {

struct NoDoubles : RigidHIPlugin::Device {
    using Device::Device;
    bool hasDoubles() const override { return false; }
};

/** Its compiler gets a text that is no kernel. */
struct NoKernels : RigidHIPlugin::Device {
    using Device::Device;
    OpenMM::ComputeProgram compile(const RigidHIPlugin::KernelProgram& program) const override {
        RigidHIPlugin::KernelProgram wrong = program;
        wrong.source += "\nWordThatNoCompilerKnows x;\n";
        return Device::compile(wrong);
    }
};

}  // namespace RigidHITest

#endif
