#include "linearalgebra/SymmetricProduct.h"

#include <algorithm>

// OpenBLAS contains dsyrk. Its header uses complex types that C++ does not accept.
extern "C" void dsyrk_(const char* triangle, const char* transposed, const int* n, const int* k,
                       const double* alpha, const double* a, const int* lda, const double* beta,
                       double* c, const int* ldc);

namespace RigidHIPlugin {

void addProductOfRows(const Eigen::MatrixXd& A, int columns, double factor, Eigen::MatrixXd& sum) {
    const int n = A.rows(), stride = sum.rows();
    const double one = 1;
    if (n > 0 && columns > 0)
        dsyrk_("L", "N", &n, &columns, &factor, A.data(), &n, &one, sum.data(), &stride);
}

void addProductOfColumns(const Eigen::MatrixXd& A, double factor, Eigen::MatrixXd& sum) {
    const int n = A.cols(), rows = A.rows(), stride = sum.rows();
    const double one = 1;
    if (n > 0 && rows > 0)
        dsyrk_("L", "T", &n, &rows, &factor, A.data(), &rows, &one, sum.data(), &stride);
}

void mirrorLower(Eigen::MatrixXd& matrix) {
    const int n = matrix.rows(), tile = 32;  // tiles that fit in a cache
    for (int left = 0; left < n; left += tile)
        for (int top = 0; top <= left; top += tile)
            for (int column = left; column < std::min(left + tile, n); column++)
                for (int row = top; row < std::min(top + tile, column); row++)
                    matrix(row, column) = matrix(column, row);
}

}  // namespace RigidHIPlugin
