#ifndef RIGIDHI_FLUID_STEP_H_
#define RIGIDHI_FLUID_STEP_H_

#include <string>

#include "stepping/PlainStep.h"

namespace RigidHIPlugin {

/**
 * LangevinHI where the fluid couples bodies, or components are fixed. A step that leads to where
 * the model has no mobility is redone as a whole. Bodies whose motion is prescribed move in halves
 * of the step, each by the velocities of its middle.
 */
class FluidStep : public PlainStep {
public:
    using PlainStep::PlainStep;
    void take() override;

private:
    std::string attempt();
    void moveThroughFluid();
    void findPrescribed();
    void movePrescribed(const Eigen::MatrixXd& velocities, double t);
    bool movePrescribedAhead();
    std::string objection() const;
    std::string objectionToPrescribed() const;
    std::string objectionHalfAStepAhead();
    /** Of the quarters of the step, 6 for each body. */
    Eigen::MatrixXd firstHalf, middle, secondHalf, ahead;
    bool isPrescribed = false;
    BodySet::Snapshot aheadBodies;
    FreeParticles::Snapshot aheadFree;
};

}  // namespace RigidHIPlugin

#endif
