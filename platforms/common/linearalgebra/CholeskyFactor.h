#ifndef RIGIDHI_CHOLESKY_FACTOR_H_
#define RIGIDHI_CHOLESKY_FACTOR_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * The Cholesky factor, A = L L^T, of a symmetric positive definite matrix. Eigen factorises small
 * matrices and LAPACK large ones, in half of Eigen's time (benchmarks/README.md). compute() neither
 * allocates nor copies: matrix and factor exchange their memory.
 */
class CholeskyFactor {
public:
    /**
     * @param matrix  only its lower triangle matters; its contents are undefined afterwards
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
     * x <- B^-1 x, where B is the leading block of A with as many rows as x. Its factor is the
     * leading block of L.
     */
    void solveLeading(Eigen::Ref<Eigen::MatrixXd> x) const;

    // Many matrices with the same leading block can share the factor of this block.
    /**
     * Begin with the leading block of so many rows; only its lower triangle matters. extend() then
     * completes the factor, any number of times.
     *
     * @return whether the block is positive definite
     */
    bool computeLeading(const Eigen::MatrixXd& matrix, int rows);
    /**
     * @param matrix  only its columns from `known` on matter: the part right of the leading block
     *     of computeLeading(), and the lower triangle below this part
     * @return whether the matrix is positive definite
     */
    bool extend(const Eigen::MatrixXd& matrix, int known);
    /**
     * The first `rows` rows of solveL(): x <- B^-1 x for these rows, with the leading block B of L.
     */
    void solveLeadingL(int rows, Eigen::MatrixXd& x) const;
    /** The other rows of solveL(), if the first `known` rows of x are already its results. */
    void continueL(int known, Eigen::MatrixXd& x) const;

private:
    Eigen::MatrixXd right;   // L_B^-1 times the columns right of the leading block
    Eigen::MatrixXd factor;  // only the lower triangle is valid
};

}  // namespace RigidHIPlugin

#endif
