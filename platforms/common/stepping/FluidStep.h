#ifndef RIGIDHI_FLUID_STEP_H_
#define RIGIDHI_FLUID_STEP_H_

#include <string>

#include "stepping/PlainStep.h"

namespace RigidHIPlugin {

/**
 * LangevinHI where the fluid couples bodies, or components are fixed. A step that leads to poses
 * where the model has no mobility is redone as a whole. Bodies with prescribed motion move in two
 * halves of the step, each with the velocities at its middle.
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
    /** Prescribed velocities, 6 for each body, at 1/4, 1/2, 3/4 and 5/4 of the step. */
    Eigen::MatrixXd firstHalf, middle, secondHalf, ahead;
    bool isPrescribed = false;
    BodySet::Snapshot aheadBodies;
    FreeParticles::Snapshot aheadFree;
};

}  // namespace RigidHIPlugin

#endif
