#include "linearalgebra/Decompositions.h"

namespace Eigen {
RIGIDHI_DECOMPOSITIONS()
namespace internal {
RIGIDHI_PRODUCTS()
}
}  // namespace Eigen

namespace RigidHIPlugin {

using namespace Eigen;

MatrixXd inverseOf(const MatrixXd& matrix) { return matrix.inverse(); }

Matrix<double, 6, 6> inverseOf(const Matrix<double, 6, 6>& matrix) { return matrix.inverse(); }

MatrixXd inverseOfPositive(const MatrixXd& matrix) {
    return matrix.llt().solve(MatrixXd::Identity(matrix.rows(), matrix.cols()));
}

MatrixXd leastSquares(const MatrixXd& A, const MatrixXd& b) {
    return A.colPivHouseholderQr().solve(b);
}

VectorXd shortestLeastSquares(const MatrixXd& A, const VectorXd& b) {
    return A.completeOrthogonalDecomposition().solve(b);
}

MatrixXd pseudoInverse(const MatrixXd& matrix) {
    return matrix.completeOrthogonalDecomposition().pseudoInverse();
}

MatrixXd triangleOfQR(const MatrixXd& matrix) {
    return HouseholderQR<MatrixXd>(matrix).matrixQR().topRows(matrix.cols());
}

}  // namespace RigidHIPlugin
