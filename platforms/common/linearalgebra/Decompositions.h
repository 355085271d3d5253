#ifndef RIGIDHI_DECOMPOSITIONS_H_
#define RIGIDHI_DECOMPOSITIONS_H_

// Eigen's decompositions and products of the types that many files use. They are compiled once, in
// Decompositions.cpp: in each file that uses one they would take seconds of compilation. A file
// includes this header instead of <Eigen/Cholesky>, <Eigen/Eigenvalues>, <Eigen/LU> and <Eigen/QR>,
// and makes a matrix of an expression before it asks for a decomposition.

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>

namespace RigidHIPlugin {

/** The inverse of a regular matrix, by its LU decomposition with pivots. */
Eigen::MatrixXd inverseOf(const Eigen::MatrixXd& matrix);
Eigen::Matrix<double, 6, 6> inverseOf(const Eigen::Matrix<double, 6, 6>& matrix);

/** The inverse of a symmetric positive definite matrix, by its Cholesky factor. */
Eigen::MatrixXd inverseOfPositive(const Eigen::MatrixXd& matrix);

/** The x with the smallest |A x - b|, column by column, where A has full rank (QR with pivots). */
Eigen::MatrixXd leastSquares(const Eigen::MatrixXd& A, const Eigen::MatrixXd& b);

/** The shortest x with the smallest |A x - b|, for A of any rank. */
Eigen::VectorXd shortestLeastSquares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

/** The Moore-Penrose inverse. */
Eigen::MatrixXd pseudoInverse(const Eigen::MatrixXd& matrix);

/** R of matrix = Q R, in the upper triangle of the first rows. What is below has no meaning. */
Eigen::MatrixXd triangleOfQR(const Eigen::MatrixXd& matrix);

}  // namespace RigidHIPlugin

#define RIGIDHI_EIGENSYSTEM(EXTERN, MATRIX)         \
    EXTERN template SelfAdjointEigenSolver<MATRIX>& \
    SelfAdjointEigenSolver<MATRIX>::compute<MATRIX>(const EigenBase<MATRIX>&, int);

#define RIGIDHI_DECOMPOSITIONS(EXTERN)                                                           \
    RIGIDHI_EIGENSYSTEM(EXTERN, MatrixXd)                                                        \
    RIGIDHI_EIGENSYSTEM(EXTERN, Matrix3d)                                                        \
    RIGIDHI_EIGENSYSTEM(EXTERN, Matrix4d)                                                        \
    EXTERN template LLT<MatrixXd>& LLT<MatrixXd>::compute<MatrixXd>(const EigenBase<MatrixXd>&); \
    EXTERN template LLT<Ref<MatrixXd>>& LLT<Ref<MatrixXd>>::compute<Ref<MatrixXd>>(              \
        const EigenBase<Ref<MatrixXd>>&);                                                        \
    EXTERN template void PartialPivLU<MatrixXd>::compute();                                      \
    EXTERN template void PartialPivLU<Matrix<double, 6, 6>>::compute();                          \
    EXTERN template void HouseholderQR<MatrixXd>::computeInPlace();                              \
    EXTERN template void ColPivHouseholderQR<MatrixXd>::computeInPlace();                        \
    EXTERN template void CompleteOrthogonalDecomposition<MatrixXd>::computeInPlace();

// Other versions of Eigen name the loops within products differently, and work without these
// instances.
#if EIGEN_WORLD_VERSION == 3 && EIGEN_MAJOR_VERSION == 4
#define RIGIDHI_PRODUCTS(EXTERN)                                                                 \
    EXTERN template struct gebp_kernel<                                                          \
        double, double, Index, blas_data_mapper<double, Index, ColMajor, 0, 1>,                  \
        gebp_traits<double, double>::mr, gebp_traits<double, double>::nr, false, false>;         \
    EXTERN template struct general_matrix_vector_product<                                        \
        Index, double, const_blas_data_mapper<double, Index, RowMajor>, RowMajor, false, double, \
        const_blas_data_mapper<double, Index, ColMajor>, false, 0>;                              \
    EXTERN template struct general_matrix_vector_product<                                        \
        Index, double, const_blas_data_mapper<double, Index, RowMajor>, RowMajor, false, double, \
        const_blas_data_mapper<double, Index, RowMajor>, false, 1>;                              \
    EXTERN template struct general_matrix_vector_product<                                        \
        Index, double, const_blas_data_mapper<double, Index, ColMajor>, ColMajor, false, double, \
        const_blas_data_mapper<double, Index, RowMajor>, false, 0>;
#else
#define RIGIDHI_PRODUCTS(EXTERN)
#endif

namespace Eigen {
RIGIDHI_DECOMPOSITIONS(extern)
namespace internal {
RIGIDHI_PRODUCTS(extern)
}
}  // namespace Eigen

#endif
