#ifndef RIGIDHI_FLOW_SOURCES_H_
#define RIGIDHI_FLOW_SOURCES_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * The sources of the fluid's flow: forces of particles on the fluid (rows of
 * HydrodynamicParticles), and stresslets in the basis of StressletBasis.h. Each particle has five
 * stresslet numbers, or none has any.
 */
struct FlowSources {
    Eigen::MatrixXd forces;
    Eigen::VectorXd stresslets;
};

/** Velocities at points, one a column, nm/ps. */
using Velocities = Eigen::Matrix3Xd;

}  // namespace RigidHIPlugin

#endif
