#ifndef RIGIDHI_PRINCIPAL_AXES_H_
#define RIGIDHI_PRINCIPAL_AXES_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/** The principal axes of points about their centre. */
struct PrincipalAxes {
    Eigen::Matrix3d axes;            // right-handed, as columns
    Eigen::Vector3d singularValues;  // roots of the second moments along them, descending
};

/**
 * The principal axes of points, by singular values. The roots of eigenvalues of second moments
 * would magnify rounding to its square root.
 *
 * @param scaled  a column for each point: its vector from the centre, times the root of its weight
 */
PrincipalAxes principalAxes(const Eigen::MatrixXd& scaled);

}  // namespace RigidHIPlugin

#endif
