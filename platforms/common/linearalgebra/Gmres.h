#ifndef RIGIDHI_GMRES_H_
#define RIGIDHI_GMRES_H_

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace RigidHIPlugin {

/**
 * Solutions of A x = b from products with A alone, for matrices that need not be symmetric.
 *
 * Method:    GMRES with restarts; Arnoldi's vectors are orthogonalised twice. Every column has its
 *            own Krylov space, but one call multiplies all columns that have not converged.
 * Accuracy:  The residual of a column, in the 2-norm, is at most `tolerance` times the norm of its
 *            solution. Where A is near the identity, as with a preconditioner, the error has about
 *            this size. An ErrorBound also bounds the error where A has small singular values, as
 *            with a poor preconditioner.
 * Reference: Saad and Schultz, SIAM J. Sci. Stat. Comput. 7:856 (1986).
 */
class Gmres {
public:
    using Product = std::function<void(const Eigen::MatrixXd& x, Eigen::MatrixXd& y)>;

    /**
     * The residual over the smallest singular value of A bounds the error. That of A in the Krylov
     * space stands for it. The iteration goes on until this bound is at most `tolerance` times the
     * norm of the solution, which is the smaller one of the 2-norm and `norm`, or until rounding
     * ends it.
     */
    struct ErrorBound {
        double tolerance;
        std::function<double(const Eigen::MatrixXd& x)> norm;
    };

    /** @param mostVectors  of a Krylov space before it restarts from the iterate */
    explicit Gmres(int mostVectors = 100, int mostIterations = 1000)
        : mostVectors(mostVectors), mostIterations(mostIterations) {}
    /**
     * Solve for every column of b, starting from 0.
     *
     * @param x           resized and overwritten
     * @param errorBound  null: the residual alone decides
     * @throws OpenMMException if a column does not reach the tolerance; the message gives the
     *     residual that it reached
     */
    void solve(const Product& product, const Eigen::MatrixXd& b, double tolerance,
               Eigen::MatrixXd& x, const ErrorBound* errorBound = nullptr);
    /**
     * Iterations of the last solve: the sum over columns, and the largest number for one column.
     */
    int getNumIterations() const { return numIterations; }
    int getNumOfSlowest() const { return numOfSlowest; }

private:
    struct Column;
    const int mostVectors, mostIterations;
    int numIterations = 0, numOfSlowest = 0;
    Eigen::MatrixXd directions, products;
};

}  // namespace RigidHIPlugin

#endif
