#ifndef RIGIDHI_REFERENCE_KERNELS_H_
#define RIGIDHI_REFERENCE_KERNELS_H_

#include "context/RigidBodyKernel.h"

namespace RigidHIPlugin {

/** CustomRigidHIIntegrator on the Reference platform. */
class ReferenceIntegrateRigidBodiesKernel : public RigidBodyKernel {
public:
    using RigidBodyKernel::RigidBodyKernel;

protected:
    std::unique_ptr<ContextArrays> createArrays(OpenMM::ContextImpl& context) override;
    std::unique_ptr<PlatformLoops> createLoops(OpenMM::ContextImpl& context) override;
};

}  // namespace RigidHIPlugin

#endif
