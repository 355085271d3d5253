#ifndef RIGIDHI_CHOLESKY_FACTOR_H_
#define RIGIDHI_CHOLESKY_FACTOR_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * The Cholesky factor, A = L L^T, of a symmetric positive definite matrix: by Eigen where the
 * matrix is small, else by LAPACK, which takes half the time (benchmarks/README.md). Nothing is
 * allocated or copied: matrix and factor exchange their memory.
 */
class CholeskyFactor {
public:
    /**
     * @param matrix  its lower triangle is read; its contents are undefined afterwards
     * @return whether the matrix is positive definite
     */
    bool compute(Eigen::MatrixXd& matrix);
    auto L() const { return factor.triangularView<Eigen::Lower>(); }
    auto U() const { return factor.transpose().triangularView<Eigen::Upper>(); }
    /** x <- L^-1 x */
    void solveL(Eigen::MatrixXd& x) const;
    /** x <- L^-T x */
    void solveU(Eigen::MatrixXd& x) const;
    /** x <- A^-1 x */
    void solve(Eigen::MatrixXd& x) const {
        solveL(x);
        solveU(x);
    }

    /**
     * x <- B^-1 x, where B is the leading block of A that has as many rows as x, whose factor is
     * the leading block of L.
     */
    void solveLeading(Eigen::Ref<Eigen::MatrixXd> x) const;

    // A leading block may be factorised by itself, and then once for many matrices that have it.
    /**
     * Begin with the leading block, of whose lower triangle so many rows are read. extend() then
     * completes the factor, any number of times.
     *
     * @return whether the block is positive definite
     */
    bool computeLeading(const Eigen::MatrixXd& matrix, int rows);
    /**
     * @param matrix  its columns from `known` on are read, which are right of the leading block of
     *     computeLeading(), and whose lower triangle is below it
     * @return whether the matrix is positive definite
     */
    bool extend(const Eigen::MatrixXd& matrix, int known);
    /** The first rows of x: x <- B^-1 x with the block B of L; solveL() of these rows. */
    void solveLeadingL(int rows, Eigen::MatrixXd& x) const;
    /** The other rows of solveL(), where the first `known` rows of x are results already. */
    void continueL(int known, Eigen::MatrixXd& x) const;

private:
    Eigen::MatrixXd right;   // L_B^-1 times the columns right of the leading block
    Eigen::MatrixXd factor;  // in the lower triangle
};

}  // namespace RigidHIPlugin

#endif
