#ifndef RIGIDHI_LANCZOS_H_
#define RIGIDHI_LANCZOS_H_

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace RigidHIPlugin {

/** A function of the eigenvalues of a matrix. */
struct SpectralFunction {
    std::function<double(double)> value;
    /** value - 1 without cancellation; empty if never needed. */
    std::function<double(double)> minusOne;

    /** exp(-h/x) and expm1(-h/x): what a decay at the rate 1/x leaves after the time h. */
    static SpectralFunction decay(double h);
    /** sqrt(1 - exp(-2 h/x)): the noise that keeps such a decay at unit variance. */
    static SpectralFunction decayNoise(double h);
    /** sqrt(x) */
    static SpectralFunction squareRoot();
    /** 1/sqrt(x) */
    static SpectralFunction inverseSquareRoot();
    /** 1/x */
    static SpectralFunction inverse();
};

/** A kind of product with a matrix A that takes less time than an exact one, and its errors. */
struct InexactProduct {
    double error = 0;  // that Product is asked for
    /** The error of a product with a vector v is at most this times the norms of A and v... */
    double ofNorm = 0;
    /** ...and this times the norm of v times |A x|/|x|, where x is the column's vector. */
    double ofVector = 0;
    /** Whether the first products may be inexact. Otherwise the iterates decide. */
    bool atOnce = true;
    /**
     * Without atOnce: the errors of inexact products together may make about this part of the
     * result. 0: the tolerance.
     */
    double share = 0;
};

/**
 * Functions of a symmetric positive definite matrix A times vectors, f(A) x, from products with A
 * alone.
 *
 * Method:    Lanczos with full reorthogonalisation. Every column has its own Krylov space, but one
 *            call multiplies all columns that have not converged. (Block Lanczos, with one space
 *            for all columns, saves 15 % of the products at best, and needs more where columns
 *            converge at different times: measured.)
 * Accuracy:  the error of a column, in the 2-norm, is at most five times `tolerance` times the norm
 *            of the result (or times 1e-140 of the column itself). If the iteration cannot reach
 *            this, it throws. The error is bounded and not estimated from the change of iterates,
 *            so plateaus do no harm: see largestFactor(). Two parts of the bound are estimates: how
 *            far eigenvalues reach beyond those of the Krylov space, and the share of these
 *            eigenvalues in the error. The bound held in all 72,000 random trials: the largest
 *            error was 3.4 tolerances. At the dimension of the matrix, or of an invariant subspace,
 *            the result is exact except for rounding. Rounding, which ill-conditioned matrices
 *            magnify, is estimated, too. If a vector has hardly any component along an eigenvector
 *            that f magnifies, the Krylov space may miss this eigenvector: the result then lacks
 *            the magnified component.
 * Cost:      for k iterations of n rows: k products, 4 n k^2 operations, n k numbers of memory for
 *            each column, and eigensystems of tridiagonal matrices of up to k rows: about ten, or
 *            one for each iteration up to k^2 = n/8, where they cost less than the products.
 * Reference: Saad, SIAM J. Numer. Anal. 29, 209 (1992); Chow, Saad, SIAM J. Sci. Comput. 36, A588
 *            (2014).
 *
 * Inexact products, if given, replace exact ones as soon as their errors do no harm. An error in
 * the k-th product enters the result as the k-th basis vector does. At coarse tolerances all
 * products may therefore be inexact, and at fine tolerances all but a few. The errors of inexact
 * products count as rounding. If they make the estimate too large, apply() repeats the computation
 * with the next kind of inexact products, and finally with exact ones.
 *
 * The method uses no measured times and no random numbers: the same input gives the same bits.
 */
class Lanczos {
public:
    /**
     * y = A x for several columns; y may have any size before.
     *
     * @param error  InexactProduct::error of the product; 0 for an exact product
     */
    using Product = std::function<void(double error, const Eigen::MatrixXd& x, Eigen::MatrixXd& y)>;
    /**
     * The norm to which the tolerance is relative: each column's own norm, or (except for
     * increments, see apply()) the norm of their sum.
     */
    enum Measure { OwnNorm, NormOfSum };

    /** The course of the iterations of apply(). */
    struct Course {
        std::vector<int> products;    // of each column
        std::vector<char> isInexact;  // each call of the product, in order
        int attempt = 0;              // the kind of inexact products
    };

    static constexpr int defaultIterations = 1000;
    /**
     * @param maxIterations  bounds memory and time; results are exact at the matrix's dimension
     * @param wanted         the tolerance that the user has set, for messages, if `tolerance` is a
     *     part of it; else 0
     */
    explicit Lanczos(double tolerance, int maxIterations = defaultIterations, double wanted = 0);
    /** A matrix B by which the caller multiplies results. */
    struct Outer {
        /** x <- B x, for one column; the number of rows may change. */
        std::function<void(Eigen::MatrixXd& x)> multiply;
        /** B A^-1 instead of B, with the inverse of the tridiagonal matrix. */
        bool ofInverse = false;
    };
    /**
     * result.col(c) = f_c(A) x.col(c). If f_c has `minusOne` and the increment (f_c - 1)(A)
     * x.col(c) is smaller, the result is the increment, and isIncrement(c) is true. The accuracy is
     * then that of the increment, and the caller adds x.col(c).
     *
     * NormOfSum is for columns that the caller adds up. The error of a column with `minusOne` that
     * has decayed may then be `tolerance` times the norm of the sum of all results. Increments and
     * columns without `minusOne` are always relative to themselves.
     *
     * For differences of results for A and for A' close to it, with the same x, the second apply()
     * should follow the course of the first. It makes as many products of each column, exact and
     * inexact ones in the same order. It makes more only if the error of the iteration exceeds six
     * tolerances, twice the usual limit. If no more products are needed, the result is a smooth
     * function of the matrix. For spectra without gaps, the relative error of the difference is
     * then up to a hundred tolerances, however close A' is to A. For clustered eigenvalues the
     * difference may be worse, and no estimate shows this.
     *
     * @param inexact kinds of inexact products, tried in this order
     * @param course  the course to follow; null for none
     * @param outer   matrices B for which the tolerance also holds for each product B f(A) x. How
     *     much B magnifies errors is measured with the last basis vector and with the change of
     *     iterates from one check to the next, which has the direction of the error. Empty: the
     *     tolerance holds for the results only.
     * @throws OpenMMException  if maxIterations or rounding prevents the tolerance (the message has
     *     the error that was reached and remedies); if A is not positive definite; if numbers are
     *     not finite
     */
    void apply(const Product& multiply, const Eigen::MatrixXd& x,
               const std::vector<SpectralFunction>& functions, Eigen::MatrixXd& result,
               Measure measure = OwnNorm, const std::vector<InexactProduct>& inexact = {},
               const Course* course = nullptr, const std::vector<Outer>& outer = {});

    /** The course of the last apply(). */
    const Course& getCourse() const { return course; }

    bool isIncrement(int column) const { return columns[column].form == Increment; }
    /**
     * The estimate of the error when the column was finished, relative to the same norm as the
     * tolerance.
     */
    double getErrorEstimate(int column) const { return columns[column].error; }
    /** Products of A with one vector in the last apply(). */
    int getNumProducts() const { return numProducts; }
    /** Calls of `multiply` in the last apply(). */
    int getNumIterations() const { return numIterations; }

private:
    struct Request;
    class Attempt;
    enum Form { Value, Increment };
    /** The present approximation of f(A) x or (f - 1)(A) x, for x of length 1. */
    struct Iterate {
        Eigen::VectorXd coefficients;  // of the basis
        double norm, bound, roundoff;  // bound: of the error of the iteration
        double lastFactor;  // largest factor with which an error of the last product enters the
                            // result
    };
    struct Column {
        double norm;            // of x
        Eigen::MatrixXd basis;  // v_1 ... v_k, v_k+1
        std::vector<double> alpha, beta;
        std::vector<char> wasInexact;  // for each product
        double scale;  // the largest number in the tridiagonal matrix, about the norm of A
        double first;  // |A x|/|x|
        double smallest, largest;  // Ritz values
        Iterate iterate[2];
        bool active, exact;
        Eigen::VectorXd before;  // coefficients at the last check
        int lastLook, nextLook;  // iterations after which the result is checked
        double excess;           // at the last check: the error over its limit
        Form form;
        double error;

        void start(const Eigen::VectorXd& x);
        void planNextLook(double newExcess);
        void put(Eigen::MatrixXd& result, int c) const;
    };
    struct Workspace {
        Eigen::VectorXd ritzValues, overlap, weights, next;
        Eigen::MatrixXd input, output, slopes;
    };

    const double tolerance;
    const int maxIterations;
    const double wanted;
    // Kept from call to call, for their memory.
    std::vector<Column> columns;
    Workspace work;
    int numProducts = 0, numIterations = 0;  // of the last apply(), like the course
    Course course;
};

}  // namespace RigidHIPlugin

#endif
