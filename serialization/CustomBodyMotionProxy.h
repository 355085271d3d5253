#ifndef OPENMMRIGIDHI_CUSTOM_BODY_MOTION_PROXY_H_
#define OPENMMRIGIDHI_CUSTOM_BODY_MOTION_PROXY_H_

#include <openmm/serialization/SerializationProxy.h>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * Writes a CustomBodyMotion and reads it back through its setters, so that a damaged file causes
 * the setters' clear exceptions.
 */
class OPENMM_EXPORT_RIGIDHI CustomBodyMotionProxy : public OpenMM::SerializationProxy {
public:
    CustomBodyMotionProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const override;
    void* deserialize(const OpenMM::SerializationNode& node) const override;
};

}  // namespace RigidHIPlugin

#endif
