#include "linearalgebra/SymmetricEigen.h"

#include <openmm/OpenMMException.h>

#include <string>

// OpenBLAS contains LAPACK. Its header uses complex types that C++ does not accept.
extern "C" {
void dsyevd_(const char* job, const char* triangle, const int* n, double* a, const int* lda,
             double* w, double* work, const int* lwork, int* iwork, const int* liwork, int* info);
}

namespace RigidHIPlugin {

namespace {

/** From this many rows on LAPACK is faster than Eigen (benchmarks/README.md). */
const int lapackRowsOfEigen = 40;

[[noreturn]] void reportFailure(int rows) {
    throw OpenMM::OpenMMException(
        "LangevinHI: the eigenvalues of a symmetric matrix of " + std::to_string(rows) +
        " rows did not converge; look for non-finite positions or radii of very different size");
}

}  // namespace

void SymmetricEigen::compute(const Eigen::MatrixXd& matrix) {
    const int n = matrix.rows();
    if (!matrix.allFinite()) reportFailure(n);
    if (n == 0) {
        eigenvalues.resize(0);
        eigenvectors.resize(0, 0);
        return;
    }
    if (n < lapackRowsOfEigen) {
        small.compute(matrix);
        if (small.info() != Eigen::Success) reportFailure(n);
        eigenvalues = small.eigenvalues();
        eigenvectors = small.eigenvectors();
        return;
    }
    eigenvectors = matrix;
    eigenvalues.resize(n);
    const int realSize = 1 + 6 * n + 2 * n * n, integerSize = 3 + 5 * n;
    if ((int)work.size() < realSize) work.resize(realSize);
    if ((int)integerWork.size() < integerSize) integerWork.resize(integerSize);
    int info = 0;
    dsyevd_("V", "L", &n, eigenvectors.data(), &n, eigenvalues.data(), work.data(), &realSize,
            integerWork.data(), &integerSize, &info);
    if (info != 0) reportFailure(n);
}

}  // namespace RigidHIPlugin
