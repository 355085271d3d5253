#ifndef RIGIDHI_SYMMETRIC_PRODUCT_H_
#define RIGIDHI_SYMMETRIC_PRODUCT_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * Add factor A A^T to the lower triangle of `sum`, using the first `columns` columns of A, by BLAS.
 */
void addProductOfRows(const Eigen::MatrixXd& A, int columns, double factor, Eigen::MatrixXd& sum);
/** Add factor A^T A to the lower triangle of `sum`, by BLAS. */
void addProductOfColumns(const Eigen::MatrixXd& A, double factor, Eigen::MatrixXd& sum);
/** Mirror the lower triangle into the upper one. */
void mirrorLower(Eigen::MatrixXd& matrix);

}  // namespace RigidHIPlugin

#endif
