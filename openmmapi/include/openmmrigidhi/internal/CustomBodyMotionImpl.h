#ifndef OPENMMRIGIDHI_CUSTOM_BODY_MOTION_IMPL_H_
#define OPENMMRIGIDHI_CUSTOM_BODY_MOTION_IMPL_H_

#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/internal/BodyExpressionsImpl.h"

namespace RigidHIPlugin {

/** A CustomBodyMotion in a Context. */
class OPENMM_EXPORT_RIGIDHI CustomBodyMotionImpl : public BodyExpressionsImpl {
public:
    explicit CustomBodyMotionImpl(const CustomBodyMotion& owner);
    const CustomBodyMotion& getOwner() const override;
    /** Also checks that a component is prescribed, and that no body is added twice. */
    void initialize(OpenMM::ContextImpl& context) override;

private:
    const CustomBodyMotion& owner;
};

}  // namespace RigidHIPlugin

#endif
