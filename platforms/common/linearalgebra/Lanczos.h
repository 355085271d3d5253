#ifndef RIGIDHI_LANCZOS_H_
#define RIGIDHI_LANCZOS_H_

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace RigidHIPlugin {

/** A function of the eigenvalues of a matrix. */
struct SpectralFunction {
    std::function<double(double)> value;
    /** value - 1 without cancellation; empty: never wanted. */
    std::function<double(double)> minusOne;

    /** exp(-h/x) and expm1(-h/x): what is left after h of a decay at the rate 1/x. */
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

/**
 * Functions of a symmetric positive definite matrix A times vectors, f(A) x, from products with A
 * alone.
 *
 * Method:    Lanczos with full reorthogonalisation. Every column has a Krylov space of its own, but
 * all columns that have not converged are multiplied in one call. (One space for all columns
 * together, block Lanczos, saves 15 % of the products at best, and takes more where columns
 * converge at different times: measured.) Accuracy:  the error of a column, in the 2-norm, is at
 * most five times `tolerance` times the norm of what is returned (or times 1e-140 of the column
 * itself); if that cannot be reached, an error. The error is bounded, not guessed from how iterates
 * move, so plateaus do no harm: see largestFactor(). What is guessed is how far eigenvalues reach
 *            beyond those of the Krylov space; of 36,000 cases with random vectors one, of 12 rows,
 * was wrong: by 6 tolerances. At the dimension of the matrix, or of an invariant subspace, the
 * result is exact but for rounding. Rounding, which ill-conditioned matrices magnify, is estimated
 * too. A vector with hardly any component along an eigenvector that f magnifies can hide it from
 * the Krylov space: a multiple of its component is then missing. Cost:      for k iterations of n
 * rows: k products, 4 n k^2 operations, n k numbers of memory for each column, and about ten
 * eigensystems of tridiagonal k x k matrices. Reference: Saad, SIAM J. Numer. Anal. 29, 209 (1992);
 * Chow, Saad, SIAM J. Sci. Comput. 36, A588 (2014).
 *
 * Rough products, if there are any, are used from where their errors do no harm: an error in the
 * k-th product enters the result as the k-th basis vector does, so from the first product on at
 * coarse tolerances, after a few at fine ones. They are counted with rounding; if that makes too
 * much of them, all is done again with exact ones.
 *
 * No clock and no random numbers: the same input gives the same bits.
 */
class Lanczos {
public:
    /** y = A x for several columns; y comes with any size. */
    typedef std::function<void(const Eigen::MatrixXd& x, Eigen::MatrixXd& y)> Product;
    /** What the tolerance is relative to: each column's own norm, or (not for increments, see
     * apply()) that of their sum. */
    enum Measure { OwnNorm, NormOfSum };

    static constexpr int defaultIterations = 1000;
    /**
     * @param maxIterations  bounds memory and time; at the matrix's dimension results are exact
     * @param wanted         the tolerance that the user has set, for messages, if only a part of it
     * is left for this; else 0
     */
    explicit Lanczos(double tolerance, int maxIterations = defaultIterations, double wanted = 0);

    /**
     * result.col(c) = f_c(A) x.col(c), or (f_c - 1)(A) x.col(c) if f_c has `minusOne` and this is
     * smaller, which isIncrement(c) tells: then the increment is what is accurate, and the caller
     * adds x.col(c).
     *
     * NormOfSum is for columns that the caller adds up: a column with `minusOne` that has decayed
     * may then be as wrong as `tolerance` times the norm of the sum of all results. Increments and
     * columns without `minusOne` are always relative to themselves.
     *
     * @param rough  if not empty: products as of MobilityAt::applyRoughly()
     * @throws OpenMMException  tolerance not reached in maxIterations or because of rounding (with
     * what was reached and what helps); A not positive definite; numbers that are not finite
     */
    void apply(const Product& multiply, const Eigen::MatrixXd& x,
               const std::vector<SpectralFunction>& functions, Eigen::MatrixXd& result,
               Measure measure = OwnNorm, const Product& rough = Product());

    bool isIncrement(int column) const { return columns[column].form == Increment; }
    /** Error relative to what the tolerance is relative to, as estimated when the column was
     * finished. */
    double getErrorEstimate(int column) const { return columns[column].error; }
    /** Products of A with one vector in the last apply(). */
    int getNumProducts() const { return numProducts; }
    /** Calls of `multiply` in the last apply(). */
    int getNumIterations() const { return numIterations; }

private:
    /** Rough products will not do. */
    struct TooRough {};
    /** @param rough  empty: exact products only */
    void iterate(const Product& multiply, const Product& rough, const Eigen::MatrixXd& x,
                 const std::vector<SpectralFunction>& functions, Eigen::MatrixXd& result,
                 Measure measure);
    enum Form { Value, Increment };
    /** f(A) x or (f - 1)(A) x for x of length 1, as far as it is known. */
    struct Iterate {
        Eigen::VectorXd coefficients;  // of the basis
        double norm, bound, roundoff;  // bound: of the error of the iteration
        double lastFactor;  // what an error of the last product is multiplied by in the result, at
                            // most
    };
    struct Column {
        double norm;            // of x
        Eigen::MatrixXd basis;  // v_1 ... v_k, v_k+1
        std::vector<double> alpha, beta;
        std::vector<char> wasRough;  // each product
        double scale;  // the largest number in the tridiagonal matrix, about the norm of A
        double smallest, largest;  // Ritz values
        Iterate iterate[2];
        bool active, exact;
        int lastLook, nextLook;  // iterations after which the result is looked at
        double excess;           // at the last look: the error over what is allowed
        Form form;
        double error;
    };

    void start(Column& column, const Eigen::VectorXd& x);
    void extend(Column& column, const Eigen::VectorXd& product);
    void evaluate(Column& column, const SpectralFunction& f);
    bool allowsRoughProducts(const Column& column) const;
    double largestFactor(const std::function<double(double)>& f,
                         const Eigen::VectorXd& functionValues, const Eigen::VectorXd& firstRow,
                         const Eigen::VectorXd& lastRow, double beta) const;
    bool isConverged(Column& column, const SpectralFunction& f, Measure measure,
                     Eigen::MatrixXd& result);
    void planNextLook(Column& column, double excess) const;
    void put(const Column& column, Eigen::MatrixXd& result, int c) const;

    const double tolerance;
    const int maxIterations;
    const double wanted;
    std::vector<Column> columns;  // kept from call to call, for their memory
    Eigen::VectorXd ritzValues, overlap, weights;
    Eigen::MatrixXd input, output, slopes;
    int numProducts = 0, numIterations = 0;
    bool isRough = false;  // whether the present attempt has had rough products
};

}  // namespace RigidHIPlugin

#endif
