#include "linearalgebra/CholeskyFactor.h"

#include <Eigen/Cholesky>
#include <cmath>

// OpenBLAS contains LAPACK. Its header would bring complex types that C++ does not accept.
extern "C" {
void dpotrf_(const char* triangle, const int* n, double* a, const int* lda, int* info);
void dtrsm_(const char* side, const char* triangle, const char* transposed, const char* diagonal,
            const int* rows, const int* columns, const double* factor, const double* a,
            const int* lda, double* b, const int* ldb);
}

namespace RigidHIPlugin {

namespace {

/**
 * From this many rows on LAPACK is faster than Eigen; from this many columns on its triangular
 * solves are faster too.
 */
const int lapackRows = 32, lapackColumns = 4;

}  // namespace

bool CholeskyFactor::compute(Eigen::MatrixXd& matrix) {
    factor.swap(matrix);
    const int n = factor.rows();
    if (n < lapackRows) {
        const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> small(factor);
        return small.info() == Eigen::Success;
    }
    int info = 0;
    dpotrf_("L", &n, factor.data(), &n, &info);
    // `info` may be 0 for a matrix of NaNs.
    return info == 0 && std::isfinite(factor.diagonal().sum());
}

void CholeskyFactor::solveL(Eigen::MatrixXd& x) const {
    const int rows = x.rows(), columns = x.cols();
    const double one = 1;
    if (rows < lapackRows || columns < lapackColumns)
        L().solveInPlace(x);
    else
        dtrsm_("L", "L", "N", "N", &rows, &columns, &one, factor.data(), &rows, x.data(), &rows);
}

void CholeskyFactor::solveU(Eigen::MatrixXd& x) const {
    const int rows = x.rows(), columns = x.cols();
    const double one = 1;
    if (rows < lapackRows || columns < lapackColumns)
        U().solveInPlace(x);
    else
        dtrsm_("L", "L", "T", "N", &rows, &columns, &one, factor.data(), &rows, x.data(), &rows);
}

void CholeskyFactor::solveLeading(Eigen::Ref<Eigen::MatrixXd> x) const {
    const auto leading = factor.topLeftCorner(x.rows(), x.rows());
    leading.triangularView<Eigen::Lower>().solveInPlace(x);
    leading.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
}

}  // namespace RigidHIPlugin
