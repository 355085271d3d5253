#ifndef RIGIDHI_SYMMETRIC_EIGEN_H_
#define RIGIDHI_SYMMETRIC_EIGEN_H_

#include "linearalgebra/Decompositions.h"

namespace RigidHIPlugin {

/**
 * The eigendecomposition matrix = V diag(values) V^T of a symmetric matrix. Eigen decomposes small
 * matrices. LAPACK's divide and conquer (dsyevd; callers hold a OneBlasThread), which is faster
 * from a few tens of rows on, decomposes the others. Cost: about 9 n^3 flops.
 */
class SymmetricEigen {
public:
    /** @throws OpenMMException if the decomposition does not converge (a non-finite matrix) */
    void compute(const Eigen::MatrixXd& matrix);
    const Eigen::VectorXd& values() const { return eigenvalues; }    // ascending
    const Eigen::MatrixXd& vectors() const { return eigenvectors; }  // columns

private:
    Eigen::VectorXd eigenvalues;
    Eigen::MatrixXd eigenvectors;
    Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> small;
    std::vector<double> work;
    std::vector<int> integerWork;
};

}  // namespace RigidHIPlugin

#endif
