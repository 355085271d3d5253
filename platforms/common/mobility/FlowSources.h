#ifndef RIGIDHI_FLOW_SOURCES_H_
#define RIGIDHI_FLOW_SOURCES_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/** What the fluid flows from: forces of particles upon it (rows of HydrodynamicParticles), and
 * stresslets in the basis of StressletBasis.h, five numbers a particle, or none. */
struct FlowSources {
    Eigen::MatrixXd forces;
    Eigen::VectorXd stresslets;
};

/** Velocities at points, one a column, nm/ps. */
typedef Eigen::Matrix3Xd Velocities;

}  // namespace RigidHIPlugin

#endif
