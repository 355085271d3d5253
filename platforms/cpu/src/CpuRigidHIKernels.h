#ifndef RIGIDHI_CPU_KERNELS_H_
#define RIGIDHI_CPU_KERNELS_H_

#include "context/RigidBodyKernel.h"

namespace RigidHIPlugin {

/** CustomRigidHIIntegrator on the CPU platform: SIMD packs of bodies, spread over threads. */
class CpuIntegrateRigidBodiesKernel : public RigidBodyKernel {
public:
    using RigidBodyKernel::RigidBodyKernel;

protected:
    std::unique_ptr<ContextArrays> createArrays(OpenMM::ContextImpl& context) override;
    std::unique_ptr<PlatformLoops> createLoops(OpenMM::ContextImpl& context) override;
};

}  // namespace RigidHIPlugin

#endif
