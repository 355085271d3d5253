#include "linearalgebra/CholeskyFactor.h"

#include <cmath>

#include "linearalgebra/Decompositions.h"

// OpenBLAS contains LAPACK. Its header uses complex types that C++ does not accept.
extern "C" {
void dpotrf_(const char* triangle, const int* n, double* a, const int* lda, int* info);
void dtrsm_(const char* side, const char* triangle, const char* transposed, const char* diagonal,
            const int* rows, const int* columns, const double* factor, const double* a,
            const int* lda, double* b, const int* ldb);
void dsyrk_(const char* triangle, const char* transposed, const int* n, const int* k,
            const double* alpha, const double* a, const int* lda, const double* beta, double* c,
            const int* ldc);
void dgemm_(const char* transposedA, const char* transposedB, const int* rows, const int* columns,
            const int* inner, const double* alpha, const double* a, const int* lda, const double* b,
            const int* ldb, const double* beta, double* c, const int* ldc);
}

namespace RigidHIPlugin {

namespace {

/**
 * LAPACK is faster than Eigen from this many rows on. Its triangular solves also need this many
 * columns to be faster.
 */
const int lapackRows = 32, lapackColumns = 4;

/** Solve for one column after the other: for several, Eigen would first copy the whole triangle. */
template <class Triangle>
void solveColumns(const Triangle& triangle, Eigen::MatrixXd& x) {
    for (int c = 0; c < x.cols(); c++) {
        auto column = x.col(c);
        triangle.solveInPlace(column);
    }
}

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
        solveColumns(L(), x);
    else
        dtrsm_("L", "L", "N", "N", &rows, &columns, &one, factor.data(), &rows, x.data(), &rows);
}

void CholeskyFactor::solveU(Eigen::MatrixXd& x) const {
    const int rows = x.rows(), columns = x.cols();
    const double one = 1;
    if (rows < lapackRows || columns < lapackColumns)
        solveColumns(U(), x);
    else
        dtrsm_("L", "L", "T", "N", &rows, &columns, &one, factor.data(), &rows, x.data(), &rows);
}

void CholeskyFactor::solveLeading(Eigen::Ref<Eigen::MatrixXd> x) const {
    const auto leading = factor.topLeftCorner(x.rows(), x.rows());
    leading.triangularView<Eigen::Lower>().solveInPlace(x);
    leading.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
}

bool CholeskyFactor::computeLeading(const Eigen::MatrixXd& matrix, int rows) {
    const int n = matrix.rows();
    factor.resize(n, n);
    factor.topLeftCorner(rows, rows) = matrix.topLeftCorner(rows, rows);
    int info = 0;
    dpotrf_("L", &rows, factor.data(), &n, &info);
    return info == 0 && std::isfinite(factor.diagonal().head(rows).sum());
}

bool CholeskyFactor::extend(const Eigen::MatrixXd& matrix, int known) {
    const int n = factor.rows(), own = n - known;
    if (own == 0) return true;
    const double one = 1, minusOne = -1;
    right = matrix.topRightCorner(known, own);
    dtrsm_("L", "L", "N", "N", &known, &own, &one, factor.data(), &n, right.data(), &known);
    factor.bottomLeftCorner(own, known) = right.transpose();
    factor.bottomRightCorner(own, own) = matrix.bottomRightCorner(own, own);
    double* const block = &factor(known, known);
    dsyrk_("L", "T", &own, &known, &minusOne, right.data(), &known, &one, block, &n);
    int info = 0;
    dpotrf_("L", &own, block, &n, &info);
    return info == 0 && std::isfinite(factor.diagonal().tail(own).sum());
}

void CholeskyFactor::solveLeadingL(int rows, Eigen::MatrixXd& x) const {
    const int n = factor.rows(), stride = x.rows(), columns = x.cols();
    const double one = 1;
    dtrsm_("L", "L", "N", "N", &rows, &columns, &one, factor.data(), &n, x.data(), &stride);
}

void CholeskyFactor::continueL(int known, Eigen::MatrixXd& x) const {
    const int n = factor.rows(), own = n - known, columns = x.cols();
    if (own == 0 || columns == 0) return;
    const double one = 1, minusOne = -1;
    dgemm_("N", "N", &own, &columns, &known, &minusOne, &factor(known, 0), &n, x.data(), &n, &one,
           &x(known, 0), &n);
    dtrsm_("L", "L", "N", "N", &own, &columns, &one, &factor(known, known), &n, &x(known, 0), &n);
}

}  // namespace RigidHIPlugin
