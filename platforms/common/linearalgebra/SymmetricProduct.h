#ifndef RIGIDHI_SYMMETRIC_PRODUCT_H_
#define RIGIDHI_SYMMETRIC_PRODUCT_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/** The lower triangle of `sum` <- that of sum + factor A A^T; of A the first `columns` are taken.
 * By BLAS. */
void addProductOfRows(const Eigen::MatrixXd& A, int columns, double factor, Eigen::MatrixXd& sum);
/** Likewise with A^T A. */
void addProductOfColumns(const Eigen::MatrixXd& A, double factor, Eigen::MatrixXd& sum);
/** The upper triangle becomes the mirrored lower one. */
void mirrorLower(Eigen::MatrixXd& matrix);

}  // namespace RigidHIPlugin

#endif
