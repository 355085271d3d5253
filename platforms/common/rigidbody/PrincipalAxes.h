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
 * The principal axes of points, from singular values: eigenvalues of the second moments would have
 * the square root of their rounding.
 *
 * @param scaled  a column for each point: the point from the centre times the root of its weight
 */
PrincipalAxes principalAxes(const Eigen::MatrixXd& scaled);

}  // namespace RigidHIPlugin

#endif
