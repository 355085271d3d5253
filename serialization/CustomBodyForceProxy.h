#ifndef OPENMMRIGIDHI_CUSTOM_BODY_FORCE_PROXY_H_
#define OPENMMRIGIDHI_CUSTOM_BODY_FORCE_PROXY_H_

#include <openmm/serialization/SerializationProxy.h>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * Writes a CustomBodyForce and reads it back through its setters, so that a damaged file causes the
 * setters' clear exceptions.
 */
class OPENMM_EXPORT_RIGIDHI CustomBodyForceProxy : public OpenMM::SerializationProxy {
public:
    CustomBodyForceProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const override;
    void* deserialize(const OpenMM::SerializationNode& node) const override;
};

}  // namespace RigidHIPlugin

#endif
