#ifndef RIGIDHI_SAVED_STEP_H_
#define RIGIDHI_SAVED_STEP_H_

#include <Eigen/Core>
#include <vector>

#include "schemes/OverdampedSchemes.h"

namespace RigidHIPlugin {

/**
 * The last step of a group without momenta. For users who ask for the flow of the fluid in this
 * step, FlowReader repeats the step from these data.
 */
struct LastStep {
    bool isKnown = false;
    CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::EulerMaruyama;
    OverdampedStep step;
    BoxVectors box = {};
    std::vector<Pose> start, end;
    std::vector<Eigen::MatrixXd> forces;      // of each stage; empty if the stage needs none
    std::vector<Eigen::MatrixXd> memory;      // of the scheme, at the start of the step
    std::vector<Eigen::MatrixXd> prescribed;  // of each stage; empty: nothing is prescribed
};

// The codec of a last step: matrices of numbers, as checkpoints and States hold them.
std::vector<Eigen::MatrixXd> numbersOf(const LastStep& step);
/**
 * Whether numbers can be those of a step of a scheme, for a group with these numbers of elements
 * and rows.
 */
bool areOfAStep(const std::vector<Eigen::MatrixXd>& numbers, const OverdampedEntry& scheme,
                int numElements, int numRows);
/** The step that has these numbers, for which areOfAStep() is true. */
LastStep stepOf(const std::vector<Eigen::MatrixXd>& numbers,
                CustomRigidHIIntegrator::Scheme scheme);

}  // namespace RigidHIPlugin

#endif
