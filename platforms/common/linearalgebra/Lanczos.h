#ifndef RIGIDHI_LANCZOS_H_
#define RIGIDHI_LANCZOS_H_

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace RigidHIPlugin {

/** A function of the eigenvalues of a matrix. */
struct SpectralFunction {
    std::function<double(double)> value;
    /** value - 1 without cancellation; empty: never needed. */
    std::function<double(double)> minusOne;

    /** exp(-h/x) and expm1(-h/x): the remainder after h of a decay at the rate 1/x. */
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

/** A kind of products with a matrix A that takes less time than exact ones, and its errors. */
struct InexactProduct {
    double error = 0;  // that the product is asked for
    /** The error of a product with a vector v is at most this times the norms of A and v... */
    double ofNorm = 0;
    /** ...and this times the norm of v times |A x|/|x|, where x is the column's vector. */
    double ofVector = 0;
    /** Whether the first products may be inexact. Otherwise the iterates decide. */
    bool atOnce = true;
    /**
     * Then their errors together make at most about this part of the result. 0: what the tolerance
     * leaves.
     */
    double share = 0;
};

/**
 * Functions of a symmetric positive definite matrix A times vectors, f(A) x, from products with A
 * alone.
 *
 * Method:    Lanczos with full reorthogonalisation. Every column has a Krylov space of its own, but
 *            all columns that have not converged are multiplied in one call. (One space for all
 *            columns together, block Lanczos, saves 15 % of the products at best, and needs more
 *            where columns converge at different times: measured.)
 * Accuracy:  the error of a column, in the 2-norm, is at most five times `tolerance` times the norm
 *            of the result (or times 1e-140 of the column itself). If that cannot be reached, there
 *            is an error. The error is bounded and not estimated from the change of iterates, so
 *            that plateaus do no harm: see largestFactor(). How far eigenvalues reach beyond those
 *            of the Krylov space, and their part of the error, are estimates. Of 72,000 cases with
 *            random vectors none was wrong: the largest error was 3.4 tolerances. At the dimension
 *            of the matrix, or of an invariant
 *            subspace, the result is exact except for rounding. Rounding, which ill-conditioned
 *            matrices magnify, is estimated too. A vector with hardly any component along an
 *            eigenvector that f magnifies can hide it from the Krylov space: a multiple of its
 *            component is then missing.
 * Cost:      for k iterations of n rows: k products, 4 n k^2 operations, n k numbers of memory for
 *            each column, and eigensystems of tridiagonal matrices of up to k rows: about ten, or
 *            one an iteration up to k^2 = n/8, where they cost less than the products.
 * Reference: Saad, SIAM J. Numer. Anal. 29, 209 (1992); Chow, Saad, SIAM J. Sci. Comput. 36, A588
 * (2014).
 *
 * Inexact products, if there are any, are used from the iteration on where their errors do no harm.
 * An error in the k-th product enters the result as the k-th basis vector does. Inexact products
 * are therefore used from the first product on at coarse tolerances, and after a few at fine ones.
 * Their errors are counted with rounding. If this makes the estimate too large, the computation is
 * repeated with the next kind of inexact products, and in the end with exact ones.
 *
 * There are no measured times and no random numbers: the same input gives the same bits.
 */
class Lanczos {
public:
    /**
     * y = A x for several columns; y may have any size before.
     *
     * @param error  InexactProduct::error; 0: the product is to be exact
     */
    using Product = std::function<void(double error, const Eigen::MatrixXd& x, Eigen::MatrixXd& y)>;
    /** What the tolerance is relative to: each column's own norm, or (not for increments, see
     * apply()) that of their sum. */
    enum Measure { OwnNorm, NormOfSum };

    /** How the columns of apply() have iterated. */
    struct Course {
        std::vector<int> products;    // of each column
        std::vector<char> isInexact;  // each call of the product, in order
        int attempt = 0;              // the kind of inexact products
    };

    static constexpr int defaultIterations = 1000;
    /**
     * @param maxIterations  bounds memory and time; at the matrix's dimension results are exact
     * @param wanted         the tolerance that the user has set, for messages, where `tolerance` is
     *     a part of it; else 0
     */
    explicit Lanczos(double tolerance, int maxIterations = defaultIterations, double wanted = 0);
    /** A matrix B by which the caller multiplies results. */
    struct Outer {
        /** x <- B x, for one column; the number of rows may change. */
        std::function<void(Eigen::MatrixXd& x)> multiply;
        /** B A^-1 in place of B. The inverse is that of the tridiagonal matrix. */
        bool ofInverse = false;
    };
    /**
     * result.col(c) = f_c(A) x.col(c). If f_c has `minusOne` and the increment (f_c - 1)(A)
     * x.col(c) is smaller, the result is the increment, which isIncrement(c) tells. The increment
     * is then what is accurate, and the caller adds x.col(c).
     *
     * NormOfSum is for columns that the caller adds up. The error of a column with `minusOne` that
     * has decayed may then be `tolerance` times the norm of the sum of all results. Increments and
     * columns without `minusOne` are always relative to themselves.
     *
     * For differences of results for A and for A' close to it, with the same x, the second apply()
     * should follow the course of the first. It makes as many products of each column, exact and
     * inexact ones in the same order, and more only where the error of the iteration exceeds six
     * tolerances, twice what it may be otherwise. Where no more are needed, the result is a smooth
     * function of the matrix. For spectra without gaps, the relative error of the difference is
     * then up to a hundred tolerances, however close A' is to A. For eigenvalues in clusters the
     * difference may be worse, and no estimate tells.
     *
     * @param inexact kinds of inexact products, which are tried in this order
     * @param course  to be followed; null: none
     * @param outer   the tolerance is also that of each product B f(A) x. How much larger errors
     *     are, relative to these products, is measured with the last basis vector, and with the
     *     change of iterates from one check to the next, which has the directions of the error.
     *     Empty: the tolerance is that of the results themselves.
     * @throws OpenMMException  if the tolerance is not reached in maxIterations or because of
     *     rounding (with what was reached and what helps); if A is not positive definite; for
     *     numbers that are not finite
     */
    void apply(const Product& multiply, const Eigen::MatrixXd& x,
               const std::vector<SpectralFunction>& functions, Eigen::MatrixXd& result,
               Measure measure = OwnNorm, const std::vector<InexactProduct>& inexact = {},
               const Course* course = nullptr, const std::vector<Outer>& outer = {});

    /** The course of the last apply(). */
    const Course& getCourse() const { return course; }

    bool isIncrement(int column) const { return columns[column].form == Increment; }
    /** Error, relative as the tolerance is, as estimated when the column was finished. */
    double getErrorEstimate(int column) const { return columns[column].error; }
    /** Products of A with one vector in the last apply(). */
    int getNumProducts() const { return numProducts; }
    /** Calls of `multiply` in the last apply(). */
    int getNumIterations() const { return numIterations; }

private:
    struct Request;
    class Attempt;
    enum Form { Value, Increment };
    /** f(A) x or (f - 1)(A) x for x of length 1, as far as it is known. */
    struct Iterate {
        Eigen::VectorXd coefficients;  // of the basis
        double norm, bound, roundoff;  // bound: of the error of the iteration
        double lastFactor;  // the largest factor of an error of the last product in the result
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
        double excess;           // at the last check: the error over what is allowed
        Form form;
        double error;

        void start(const Eigen::VectorXd& x);
        void planNextLook(double newExcess);
        void put(Eigen::MatrixXd& result, int c) const;
    };
    struct Workspace {
        Eigen::VectorXd ritzValues, overlap, weights;
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
