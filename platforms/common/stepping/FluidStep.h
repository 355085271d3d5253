#ifndef RIGIDHI_FLUID_STEP_H_
#define RIGIDHI_FLUID_STEP_H_

#include <string>

#include "stepping/PlainStep.h"

namespace RigidHIPlugin {

/** LangevinHI where the fluid couples bodies. A step that leads to where the model has no mobility
 * is redone as a whole. */
class FluidStep : public PlainStep {
public:
    using PlainStep::PlainStep;
    void take() override;

private:
    std::string attempt();
    void moveThroughFluid();
    std::string objection() const;
    std::string objectionHalfAStepAhead();
    BodySet::Snapshot aheadBodies;
    FreeParticles::Snapshot aheadFree;
};

}  // namespace RigidHIPlugin

#endif
