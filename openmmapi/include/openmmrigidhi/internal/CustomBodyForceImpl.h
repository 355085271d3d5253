#ifndef OPENMMRIGIDHI_CUSTOM_BODY_FORCE_IMPL_H_
#define OPENMMRIGIDHI_CUSTOM_BODY_FORCE_IMPL_H_

#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/internal/BodyExpressionsImpl.h"

namespace RigidHIPlugin {

/** A CustomBodyForce in a Context. */
class OPENMM_EXPORT_RIGIDHI CustomBodyForceImpl : public BodyExpressionsImpl {
public:
    explicit CustomBodyForceImpl(const CustomBodyForce& owner);
    const CustomBodyForce& getOwner() const override;

private:
    const CustomBodyForce& owner;
};

}  // namespace RigidHIPlugin

#endif
