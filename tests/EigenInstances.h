#ifndef RIGIDHI_EIGEN_INSTANCES_H_
#define RIGIDHI_EIGEN_INSTANCES_H_

// Decompositions and products of dynamic matrices. They are compiled once, in EigenInstances.cpp,
// instead of in each file that tests eigenvalues or multiplies matrices.

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#define RIGIDHI_EIGEN_INSTANCES(EXTERN)                                                          \
    EXTERN template SelfAdjointEigenSolver<MatrixXd>&                                            \
    SelfAdjointEigenSolver<MatrixXd>::compute<MatrixXd>(const EigenBase<MatrixXd>&, int);        \
    EXTERN template LLT<MatrixXd>& LLT<MatrixXd>::compute<MatrixXd>(const EigenBase<MatrixXd>&); \
    EXTERN template void PartialPivLU<MatrixXd>::compute();

// Other versions of Eigen name the loops within products differently, and work without these
// instances.
#if EIGEN_WORLD_VERSION == 3 && EIGEN_MAJOR_VERSION == 4
#define RIGIDHI_EIGEN_PRODUCTS(EXTERN)                                                           \
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
#define RIGIDHI_EIGEN_PRODUCTS(EXTERN)
#endif

namespace Eigen {
RIGIDHI_EIGEN_INSTANCES(extern)
namespace internal {
RIGIDHI_EIGEN_PRODUCTS(extern)
}
}  // namespace Eigen

#endif
