#include "rigidbody/PrincipalAxes.h"

#include <Eigen/SVD>

#include "linearalgebra/Decompositions.h"

namespace RigidHIPlugin {

PrincipalAxes principalAxes(const Eigen::MatrixXd& scaled) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(scaled, Eigen::ComputeFullU);
    PrincipalAxes result;
    result.singularValues.setZero();
    result.singularValues.head(svd.singularValues().size()) = svd.singularValues();
    result.axes = svd.matrixU();
    if (result.axes.determinant() < 0) result.axes.col(2) = -result.axes.col(2);
    return result;
}

}  // namespace RigidHIPlugin
