#ifndef OPENMMRIGIDHI_CUSTOM_RIGID_HI_INTEGRATOR_PROXY_H_
#define OPENMMRIGIDHI_CUSTOM_RIGID_HI_INTEGRATOR_PROXY_H_

#include <openmm/serialization/SerializationProxy.h>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * Writes all settings of a CustomRigidHIIntegrator, its bodies and their geometry as far as it is
 * known. It reads them back through the integrator's setters, so that a damaged file causes the
 * setters' clear exceptions.
 */
class OPENMM_EXPORT_RIGIDHI CustomRigidHIIntegratorProxy : public OpenMM::SerializationProxy {
public:
    CustomRigidHIIntegratorProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const override;
    void* deserialize(const OpenMM::SerializationNode& node) const override;
};

}  // namespace RigidHIPlugin

#endif
