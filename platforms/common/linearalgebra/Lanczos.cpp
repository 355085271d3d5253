#include "linearalgebra/Lanczos.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <sstream>

#include "linearalgebra/Decompositions.h"
#include "linearalgebra/ToleranceText.h"

using namespace OpenMM;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace RigidHIPlugin {

namespace {

// Rounding acts on the iteration like a change of A by this share of its norm (full
// reorthogonalisation is backward stable) and a change of the result by this share. TestLanczos
// compares these estimates with measured errors. With 4 instead of 8, and without the second share,
// one case in twenty exceeded its estimate.
const double roundingError = 8 * DBL_EPSILON;

/** (f(a) - f(b))/(a - b), and f'(a) for a = b. */
double slope(const std::function<double(double)>& f, double a, double f_a, double b, double f_b) {
    const double separated = 1e-6;  // below it the difference quotient loses half of the digits;
                                    // use the derivative
    if (std::abs(a - b) > separated * std::max(a, b)) return (f_a - f_b) / (a - b);
    return (f(a * (1 + separated)) - f(a * (1 - separated))) / (2 * separated * a);
}

/**
 * The error's component along an eigenvector u of A, of eigenvalue x, is exactly
 *
 *     beta_k (u.v_k+1) sum_i S_ki S_1i f[theta_i, x]
 *
 * with Ritz values theta and eigenvectors S of the tridiagonal matrix (compare f(A) v_1 with the
 * polynomial that takes f's values at theta). Between the extreme Ritz values, the largest
 * magnitude of this sum bounds the part of the error there, since v_k+1 has length 1. Few
 * eigenvalues lie beyond them, and v_k+1 has only a small part along their eigenvectors. The
 * squares of S's last row are the parts of v_k along Ritz vectors, and a random vector of n rows
 * has a part of 1/n along an eigenvector. In v_k+1 either part may be larger by a factor `growth`
 * if an eigenvalue is still missing. The residuals estimate how far eigenvalues reach beyond Ritz
 * values.
 */
double largestFactor(const std::function<double(double)>& f, const VectorXd& ritzValues,
                     const VectorXd& functionValues, const VectorXd& firstRow,
                     const VectorXd& lastRow, double beta, int n) {
    // An eigenvalue lies within one residual of each Ritz value, but the extreme eigenvalue may be
    // farther out. Early residuals are not meaningful; `least` then limits how far the interval
    // reaches towards zero.
    const double residuals = 3, least = 0.01, growth = 16;
    const int k = ritzValues.size();
    const double smallest = ritzValues[0], largest = ritzValues[k - 1];
    const double low =
        std::max(smallest - residuals * beta * std::abs(lastRow[0]), least * smallest);
    const double high = largest + residuals * beta * std::abs(lastRow[k - 1]);
    // The sum is smooth, and for most functions it is largest at an end.
    const auto largestBetween = [&](double from, double to, int samples) {
        double most = 0;
        for (int s = 0; s <= samples; s++) {
            const double x = from * std::pow(to / from, static_cast<double>(s) / samples);
            const double f_x = f(x);
            double sum = 0;
            for (int i = 0; i < k; i++)
                sum +=
                    lastRow[i] * firstRow[i] * slope(f, ritzValues[i], functionValues[i], x, f_x);
            most = std::max(most, std::abs(sum));
        }
        return most;
    };
    const double within = largestBetween(smallest, largest, 24),
                 below = largestBetween(low, smallest, 8), above = largestBetween(largest, high, 8);
    const auto part = [&](double ofLast) {
        return std::min(1.0, growth * (ofLast * ofLast + 1.0 / n));
    };
    return std::sqrt(within * within + part(lastRow[0]) * below * below +
                     part(lastRow[k - 1]) * above * above);
}

/**
 * T^-1 c for a positive definite tridiagonal matrix T with this diagonal and these numbers beside
 * it.
 */
VectorXd solveTridiagonal(const std::vector<double>& diagonal, const std::vector<double>& beside,
                          const VectorXd& c) {
    const int n = c.size();
    VectorXd pivot(n), x(n);
    for (int i = 0; i < n; i++) {
        const double factor = i > 0 ? beside[i - 1] / pivot[i - 1] : 0;
        pivot[i] = diagonal[i] - (i > 0 ? factor * beside[i - 1] : 0);
        x[i] = c[i] - (i > 0 ? factor * x[i - 1] : 0);
    }
    for (int i = n - 1; i >= 0; i--)
        x[i] = (x[i] - (i + 1 < n ? beside[i] * x[i + 1] : 0)) / pivot[i];
    return x;
}

}  // namespace

SpectralFunction SpectralFunction::decay(double h) {
    return {[h](double x) { return std::exp(-h / x); },
            [h](double x) { return std::expm1(-h / x); }};
}
SpectralFunction SpectralFunction::decayNoise(double h) {
    return {[h](double x) { return std::sqrt(-std::expm1(-2 * h / x)); }, {}};
}
SpectralFunction SpectralFunction::squareRoot() {
    return {[](double x) { return std::sqrt(x); }, {}};
}
SpectralFunction SpectralFunction::inverseSquareRoot() {
    return {[](double x) { return 1 / std::sqrt(x); }, {}};
}

SpectralFunction SpectralFunction::inverse() {
    return {[](double x) { return 1 / x; }, {}};
}

Lanczos::Lanczos(double tolerance, int maxIterations, double wanted)
    : tolerance(tolerance), maxIterations(maxIterations), wanted(wanted) {}

void Lanczos::Column::start(const VectorXd& x) {
    norm = x.norm();
    if (!std::isfinite(norm))
        throw OpenMMException(
            "MobilityForce: a vector for the Lanczos iteration is not finite; look at the "
            "positions, forces and torques");
    alpha.clear();
    beta.clear();
    wasInexact.clear();
    scale = 0;
    active = norm > 0;
    exact = false;
    nextLook = 3;  // before that, Ritz values say too little about the other eigenvalues
    lastLook = 0;
    form = Value;
    error = 0;
    before.resize(0);
    for (Iterate& each : iterate) each.coefficients.resize(0);
    const int atFirst = 32;
    if (basis.rows() != x.size()) basis.resize(x.size(), std::min<int>(atFirst, x.size()));
    if (active) basis.col(0) = x / norm;
}

/**
 * Plan the next check, which costs k^3 operations. Checks are rare while the error is far too
 * large, and frequent near the end, to avoid superfluous iterations. For a large matrix a check
 * takes far less time than a product, so every iteration has one.
 *
 * @param newExcess  the error over its limit
 */
void Lanczos::Column::planNextLook(double newExcess) {
    const int k = alpha.size(), rowsOfLarge = 8 * k * k;
    int wait = basis.rows() > rowsOfLarge ? 1 : std::max(1, k / 4);
    // Errors shrink by about the same factor in each iteration, later by more.
    const double rate = std::log(excess / newExcess) / (k - lastLook), share = 0.6;
    if (lastLook > 0 && rate > 0)
        wait = std::min<double>(wait, std::max(1.0, share * std::log(newExcess) / rate));
    lastLook = k;
    nextLook = k + wait;
    excess = newExcess;
}

/** Write the vector of the last iterate into a column of the results. */
void Lanczos::Column::put(MatrixXd& result, int c) const {
    const VectorXd& y = iterate[form].coefficients;
    result.col(c).noalias() = norm * (basis.leftCols(y.size()) * y);
}

/** The arguments of apply(). */
struct Lanczos::Request {
    const Product& multiply;
    const MatrixXd& x;
    const std::vector<SpectralFunction>& functions;
    const Measure measure;
    const Course* const course;  // to follow
    const std::vector<Outer>& outer;
};

/** The iteration of all columns with one kind of inexact products, or with exact products only. */
class Lanczos::Attempt {
public:
    /** @param inexact  null: exact products only */
    Attempt(Lanczos& lanczos, const Request& request, const InexactProduct* inexact)
        : lanczos(lanczos), request(request), inexact(inexact),
          isInexact(inexact && inexact->atOnce), columns(lanczos.columns), work(lanczos.work) {}
    /**
     * @return whether the results reach the tolerance. If not, inexact products are not accurate
     *     enough; without inexact products run() throws instead.
     */
    bool run(MatrixXd& result);

private:
    enum Verdict { NotYet, Converged, TooInexact };
    void start(MatrixXd& result);
    bool extendAll(int k);
    bool judgeAll(int k, MatrixXd& result);
    bool extend(Column& column, const VectorXd& product);
    bool evaluate(Column& column, const SpectralFunction& f);
    Verdict judge(Column& column, const SpectralFunction& f, MatrixXd& result);
    void magnify(Column& column);
    double errorOfInexact(const Column& column) const;
    bool allowsInexactProducts(const Column& column) const;

    Lanczos& lanczos;
    const Request& request;
    const InexactProduct* const inexact;
    bool isInexact;  // whether the next product is inexact; without a course, all later ones are,
                     // too
    std::vector<Column>& columns;
    Workspace& work;
    int numActive = 0;
    Course course;  // of this attempt
};

void Lanczos::apply(const Product& multiply, const MatrixXd& x,
                    const std::vector<SpectralFunction>& functions, MatrixXd& result,
                    Measure measure, const std::vector<InexactProduct>& inexact,
                    const Course* toFollow, const std::vector<Outer>& outer) {
    numProducts = numIterations = 0;
    const Request request = {multiply, x, functions, measure, toFollow, outer};
    const int count = inexact.size();
    const int first = toFollow ? std::min(toFollow->attempt, count) : 0;
    for (int kind = first; kind <= count; kind++) {
        Attempt attempt(*this, request, kind < count ? &inexact[kind] : nullptr);
        if (!attempt.run(result)) continue;
        course.attempt = kind;
        return;
    }
}

bool Lanczos::Attempt::run(MatrixXd& result) {
    start(result);
    for (int k = 1; numActive > 0; k++) {
        if (!extendAll(k)) return false;
        if (!judgeAll(k, result)) return false;
    }
    lanczos.course = course;
    return true;
}

void Lanczos::Attempt::start(MatrixXd& result) {
    const int count = request.x.cols();
    result.setZero(request.x.rows(), count);
    columns.resize(count);
    for (int c = 0; c < count; c++) {
        columns[c].start(request.x.col(c));
        numActive += columns[c].active;
        if (request.course) columns[c].nextLook = request.course->products[c];
    }
    course.products.assign(count, 0);
}

/**
 * The k-th product of all columns that have not converged.
 *
 * @return whether inexact products are accurate enough
 */
bool Lanczos::Attempt::extendAll(int k) {
    const int count = columns.size();
    work.input.resize(request.x.rows(), numActive);
    for (int c = 0, i = 0; c < count; c++)
        if (columns[c].active) work.input.col(i++) = columns[c].basis.col(k - 1);
    if (inexact && request.course && k <= static_cast<int>(request.course->isInexact.size()))
        isInexact = request.course->isInexact[k - 1];
    course.isInexact.push_back(isInexact);
    request.multiply(isInexact ? inexact->error : 0, work.input, work.output);
    lanczos.numIterations++;
    lanczos.numProducts += numActive;
    for (int c = 0, i = 0; c < count; c++)
        if (columns[c].active && !extend(columns[c], work.output.col(i++))) return false;
    return true;
}

/**
 * Check the columns that are due after k products.
 *
 * @return whether inexact products are accurate enough
 */
bool Lanczos::Attempt::judgeAll(int k, MatrixXd& result) {
    const int count = columns.size();
    // Until products may become inexact, check every iterate for this.
    const bool mayBecomeInexact = inexact && !isInexact && !request.course;
    const bool last = k >= lanczos.maxIterations;
    const auto isDue = [&](const Column& column) {
        return column.active && (column.exact || last || k == column.nextLook);
    };
    for (int c = 0; c < count; c++)
        if (isDue(columns[c]) || (mayBecomeInexact && columns[c].active))
            if (!evaluate(columns[c], request.functions[c])) return false;
    for (int c = 0; c < count; c++) {
        Column& column = columns[c];
        if (!isDue(column)) continue;
        const Verdict verdict = judge(column, request.functions[c], result);
        if (verdict == TooInexact || (verdict == NotYet && last && isInexact)) return false;
        if (verdict == NotYet && last) {
            std::ostringstream message;
            message << "MobilityForce: after " << k
                    << " products the Lanczos iteration has a relative error of " << column.error
                    << ", above " << toleranceText(lanczos.tolerance, lanczos.wanted)
                    << "; raise setSolverTolerance(), or use setSolver(Dense)";
            throw OpenMMException(message.str());
        }
        if (verdict == NotYet) continue;
        column.put(result, c);
        course.products[c] = k;
        column.active = false;
        numActive--;
    }
    if (mayBecomeInexact)
        isInexact = std::all_of(columns.begin(), columns.end(), [&](const Column& column) {
            return !column.active || allowsInexactProducts(column);
        });
    return true;
}

/** The error of an inexact product with a vector of length 1. */
double Lanczos::Attempt::errorOfInexact(const Column& column) const {
    return inexact ? inexact->ofNorm * column.scale + inexact->ofVector * column.first : 0;
}

/**
 * Errors of products enter the result with factors that shrink about as fast as the coefficients of
 * the result. All later products together therefore have at most a few times the effect of the last
 * product.
 */
bool Lanczos::Attempt::allowsInexactProducts(const Column& column) const {
    const double ofLast = 0.25;  // the share of the last product
    const double share = ofLast * (inexact->share > 0 ? inexact->share : lanczos.tolerance);
    const Iterate& iterate = column.iterate[column.form];
    return errorOfInexact(column) * iterate.lastFactor <= share * iterate.norm;
}

/**
 * Add a basis vector and a row of the tridiagonal matrix.
 *
 * @return whether inexact products are accurate enough
 */
bool Lanczos::Attempt::extend(Column& column, const VectorXd& product) {
    const int k = column.alpha.size() + 1, n = product.size();
    const auto basis = column.basis.leftCols(k);
    VectorXd& w = work.next;
    w = product;
    if (k > 1) w -= column.beta[k - 2] * basis.col(k - 2);
    double alpha = basis.col(k - 1).dot(w);
    w -= alpha * basis.col(k - 1);
    // What is left overlaps the basis by rounding and by errors of products alone. One pass over
    // the basis removes these overlaps, unless the pass leaves so little that its own rounding
    // counts.
    const double enough = 0.7;
    double beta = w.norm();
    for (int pass = 0; pass < 3; pass++) {
        work.overlap.noalias() = basis.transpose() * w;
        w.noalias() -= basis * work.overlap;
        alpha += work.overlap[k - 1];
        const double before = beta;
        beta = w.norm();
        if (!(beta < enough * before)) break;
    }
    if (!std::isfinite(alpha + beta) && isInexact) return false;
    if (!std::isfinite(alpha + beta))
        throw OpenMMException(
            "MobilityForce: a product with the mobility is not finite; look at the positions");
    column.alpha.push_back(alpha);
    column.scale = std::max(column.scale, std::abs(alpha) + beta);
    if (k == 1) column.first = std::hypot(alpha, beta);
    column.wasInexact.push_back(isInexact);
    column.exact =
        k == n || beta <= (isInexact ? errorOfInexact(column) : roundingError * column.scale);
    if (column.exact) return true;
    column.beta.push_back(beta);
    if (column.basis.cols() == k) column.basis.conservativeResize(n, std::min(2 * k, n));
    column.basis.col(k) = w / beta;
    return true;
}

/**
 * f of the tridiagonal matrix.
 *
 * @return whether inexact products are accurate enough
 */
bool Lanczos::Attempt::evaluate(Column& column, const SpectralFunction& f) {
    const int k = column.alpha.size();
    // Scale the matrix to about 1: Eigen's test for zeros beside the diagonal assumes this.
    Eigen::SelfAdjointEigenSolver<MatrixXd> solver;
    solver.computeFromTridiagonal(
        Eigen::Map<const VectorXd>(column.alpha.data(), k) / column.scale,
        Eigen::Map<const VectorXd>(column.beta.data(), k - 1) / column.scale);
    VectorXd& ritzValues = work.ritzValues;
    ritzValues = column.scale * solver.eigenvalues();
    column.smallest = ritzValues[0];
    column.largest = ritzValues[k - 1];
    if (solver.info() != Eigen::Success || !(column.smallest > 0)) {
        if (isInexact) return false;
        std::ostringstream message;
        message << "MobilityForce: the mobility is not positive definite (eigenvalues from "
                << column.smallest << " to " << column.largest
                << "); look for particles at the same place";
        throw OpenMMException(message.str());
    }
    const VectorXd firstRow = solver.eigenvectors().row(0),
                   lastRow = solver.eigenvectors().row(k - 1);
    for (Form form : {Value, Increment}) {
        const auto& function = form == Value ? f.value : f.minusOne;
        if (!function) continue;
        VectorXd functionValues(k);
        for (int i = 0; i < k; i++) functionValues[i] = function(ritzValues[i]);
        if (!functionValues.allFinite())
            throw OpenMMException(
                "MobilityForce: a function of the mobility is not finite; look at the positions");
        Iterate& iterate = column.iterate[form];
        iterate.coefficients.noalias() =
            solver.eigenvectors() * functionValues.cwiseProduct(firstRow);
        iterate.norm = iterate.coefficients.norm();
        // To first order a change E of the matrix changes f by f[a, b] E_ab between eigenvectors of
        // a and b.
        MatrixXd& slopes = work.slopes;
        slopes.resize(k, k);
        for (int i = 0; i < k; i++)
            for (int j = 0; j <= i; j++)
                slopes(i, j) = slopes(j, i) = slope(function, ritzValues[i], functionValues[i],
                                                    ritzValues[j], functionValues[j]);
        const double steepest =
            slopes.cwiseAbs().colwise().maxCoeff().transpose().cwiseProduct(firstRow).norm();
        // An error of the j-th product changes only the image of the j-th basis vector.
        double ofInexact = 0;
        for (int j = 0; j < k; j++) {
            work.weights = solver.eigenvectors().row(j).transpose().cwiseProduct(firstRow);
            iterate.lastFactor = (slopes * work.weights).cwiseAbs().maxCoeff();
            if (column.wasInexact[j]) ofInexact += iterate.lastFactor;
        }
        iterate.roundoff = roundingError * (column.scale * steepest + iterate.norm) +
                           errorOfInexact(column) * std::min(ofInexact, steepest);
        iterate.bound = column.exact
                            ? 0
                            : column.beta[k - 1] *
                                  largestFactor(function, ritzValues, functionValues, firstRow,
                                                lastRow, column.beta[k - 1], column.basis.rows());
    }
    column.form = f.minusOne && column.iterate[Increment].norm < column.iterate[Value].norm
                      ? Increment
                      : Value;
    return true;
}

/**
 * Outer matrices magnify errors relative to the result. The errors of products have no preferred
 * direction, like a basis vector. The error of the iteration has the direction of the changes of
 * iterates.
 */
void Lanczos::Attempt::magnify(Column& column) {
    Iterate& iterate = column.iterate[column.form];
    const VectorXd& y = iterate.coefficients;
    const int k = y.size();
    VectorXd change;
    if (column.before.size() > 0) {
        change = y;
        change.head(column.before.size()) -= column.before;
    }
    double ofErrors = 1, ofRounding = 1;
    for (const Outer& o : request.outer) {
        const auto growth = [&](const VectorXd& coefficients) {
            const double norm = coefficients.norm();
            if (!(norm > 0)) return 1.0;
            if (o.ofInverse)
                work.input.noalias() = column.basis.leftCols(k) *
                                       solveTridiagonal(column.alpha, column.beta, coefficients);
            else
                work.input.noalias() = column.basis.leftCols(coefficients.size()) * coefficients;
            o.multiply(work.input);
            return work.input.norm() / norm;
        };
        // The tridiagonal matrix, and so the inverse, does not cover the last basis vector.
        const auto growthOfLast = [&] {
            if (o.ofInverse) return growth(VectorXd::Unit(k, k - 1));
            work.input = column.basis.col(k);
            o.multiply(work.input);
            return work.input.norm();
        };
        const double ofResult = growth(y);
        if (!(ofResult > 0)) continue;  // no error can be relative to zero
        double ofProducts = ofResult;
        if (!column.exact) ofProducts = std::max(ofProducts, growthOfLast());
        double ofIteration = ofProducts;
        if (change.size() > 0) ofIteration = std::max(ofIteration, growth(change));
        ofErrors = std::max(ofErrors, ofIteration / ofResult);
        ofRounding = std::max(ofRounding, ofProducts / ofResult);
    }
    iterate.bound *= ofErrors;
    iterate.roundoff *= ofRounding;
}

Lanczos::Attempt::Verdict Lanczos::Attempt::judge(Column& column, const SpectralFunction& f,
                                                  MatrixXd& result) {
    // The error must be below five tolerances. `shareOfIteration` of them are for the error of the
    // iteration (the bound is larger than this error), `shareOfRounding` for rounding, and the rest
    // for the estimated interval of the eigenvalues. An apply() that follows a course has a
    // slightly different matrix, and the first apply() may have stopped just below its limit. The
    // limit is then twice as high, so that the number of products stays the same.
    const double tolerance = lanczos.tolerance;
    const double shareOfIteration = request.course ? 6 : 3, shareOfRounding = 1;
    // A result smaller than its vector by this factor counts as zero, because squares of its
    // elements underflow.
    const double nothing = 1e-140;
    const Iterate& iterate = column.iterate[column.form];
    // No bound can be smaller than its own rounding error.
    const auto iterationConverged = [&](double norm) {
        return iterate.bound <= std::max(shareOfIteration * tolerance * norm, iterate.roundoff);
    };
    const auto roundingIsSmall = [&](double norm) {
        return iterate.roundoff <= shareOfRounding * tolerance * norm;
    };
    double norm = std::max(iterate.norm, nothing);
    if (request.measure == NormOfSum && f.minusOne && column.form == Value &&
        !(iterationConverged(norm) && roundingIsSmall(norm))) {
        for (int other = 0; other < static_cast<int>(columns.size()); other++)
            if (columns[other].active) columns[other].put(result, other);
        norm = std::max(norm, result.rowwise().sum().norm() / column.norm);
    }
    // Magnifying makes errors larger, and takes longer than all else here. Before convergence it
    // can only show that products are too inexact, which a look now and then finds in time.
    if (!request.outer.empty()) {
        const int k = column.alpha.size(), betweenLooks = 8;
        const bool isLook = isInexact && inexact->ofVector > 0 && k % betweenLooks == 0;
        if (iterationConverged(norm) || isLook || k >= lanczos.maxIterations) magnify(column);
        column.before = iterate.coefficients;
    }
    column.error = (iterate.bound + iterate.roundoff) / norm;
    if (!iterationConverged(norm)) {
        // Errors of the first products count most, so more products do not help.
        if (isInexact && inexact->ofVector > 0 && !roundingIsSmall(norm)) return TooInexact;
        column.planNextLook(iterate.bound / (shareOfIteration * tolerance * norm));
        return NotYet;
    }
    if (!roundingIsSmall(norm)) {
        if (isInexact) return TooInexact;
        std::ostringstream message;
        message << "MobilityForce: " << toleranceText(tolerance, lanczos.wanted)
                << " cannot be reached: rounding makes an error of " << column.error
                << " with a mobility whose eigenvalues go from " << column.smallest << " to "
                << column.largest
                << "; raise setSolverTolerance(), or choose radii, masses and a step size that "
                   "bring the eigenvalues closer together";
        throw OpenMMException(message.str());
    }
    return Converged;
}

}  // namespace RigidHIPlugin
