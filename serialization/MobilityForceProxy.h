#ifndef OPENMMRIGIDHI_MOBILITY_FORCE_PROXY_H_
#define OPENMMRIGIDHI_MOBILITY_FORCE_PROXY_H_

#include <openmm/serialization/SerializationProxy.h>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/** Writes all settings of a MobilityForce and reads them back through its setters. */
class OPENMM_EXPORT_RIGIDHI MobilityForceProxy : public OpenMM::SerializationProxy {
public:
    MobilityForceProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const override;
    void* deserialize(const OpenMM::SerializationNode& node) const override;
};

}  // namespace RigidHIPlugin

#endif
