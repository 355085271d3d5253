#ifndef RIGIDHI_BROWNIAN_STEP_H_
#define RIGIDHI_BROWNIAN_STEP_H_

#include "stepping/Step.h"

namespace RigidHIPlugin {

/**
 * A step without momenta (Brownian dynamics): the stages of the scheme, each with its forces. A
 * group of bodies that is led to where the model has no mobility is redone by itself with new
 * noise, so that what a step costs does not grow faster than the number of groups. The Fluid counts
 * the attempts of each.
 *
 * Groups that are redone want the forces of later stages again, and OpenMM evaluates those of all:
 * the others stand where theirs were evaluated then, and keep what they have reached. If OpenMM
 * forces act between groups, these have felt the poses that were rejected.
 */
class BrownianStep : public Step {
public:
    explicit BrownianStep(const StepParts& parts) : parts(parts) {}
    void take() override;

private:
    void runStage(int stage);
    void writePositions();
    StepParts parts;
};

}  // namespace RigidHIPlugin

#endif
