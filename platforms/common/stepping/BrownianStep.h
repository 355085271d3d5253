#ifndef RIGIDHI_BROWNIAN_STEP_H_
#define RIGIDHI_BROWNIAN_STEP_H_

#include "stepping/Step.h"

namespace RigidHIPlugin {

/**
 * A step without momenta (Brownian dynamics): the stages of the scheme, each with its forces. If
 * the step leads a group of bodies to poses where the model has no mobility, this group alone is
 * redone with new noise. The cost of a step therefore does not grow faster than the number of
 * groups. The fluid counts the attempts of each group.
 *
 * Groups that are redone need the forces of later stages again, and OpenMM evaluates the forces of
 * all groups. For this evaluation the other groups go back to the poses where their forces of this
 * stage were evaluated, and they keep their results. If OpenMM forces act between groups, the other
 * groups have felt the rejected poses.
 *
 * In a sheared fluid the box tilts with the flow. Each stage has the box of its own time, for its
 * forces, for the fluid, and for judging the poses where it ends.
 */
class BrownianStep : public Step {
public:
    explicit BrownianStep(const StepParts& parts) : parts(parts) {}
    void take() override;

private:
    void findPrescribed();
    bool isSheared() const;
    void checkStrain() const;
    void tiltBox(double part);
    void runStage(int stage);
    void writePositions();
    StepParts parts;
    std::vector<Eigen::MatrixXd> prescribed;  // of each stage; empty: nothing is prescribed
};

}  // namespace RigidHIPlugin

#endif
