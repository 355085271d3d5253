#ifndef RIGIDHI_DEVICE_OF_TESTS_H_
#define RIGIDHI_DEVICE_OF_TESTS_H_

// OpenMM's class of the platform that a program of device/ tests.

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

#endif
