#include "linearalgebra/Lanczos.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cfloat>
#include <cmath>
#include <sstream>

#include "linearalgebra/ToleranceText.h"

using namespace OpenMM;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace RigidHIPlugin {

namespace {

// Rounding errors of the iteration are those of a matrix that differs from A by this share of its
// norm (full reorthogonalisation is backward stable), and of a result that differs by this share.
// TestLanczos compares them with measured errors. With 4, and without the second share, one case in
// twenty exceeded its estimate.
const double roundingError = 8 * DBL_EPSILON;

/** (f(a) - f(b))/(a - b), and f'(a) for a = b. */
double slope(const std::function<double(double)>& f, double a, double f_a, double b, double f_b) {
    const double separated = 1e-6;  // below it the difference quotient loses half of the digits,
                                    // and the derivative is used
    if (std::abs(a - b) > separated * std::max(a, b)) return (f_a - f_b) / (a - b);
    return (f(a * (1 + separated)) - f(a * (1 - separated))) / (2 * separated * a);
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

void Lanczos::apply(const Product& multiply, const MatrixXd& x,
                    const std::vector<SpectralFunction>& functions, MatrixXd& result,
                    Measure measure, const std::vector<Rough>& kinds, const Course* toFollow) {
    numProducts = numIterations = 0;
    const int count = kinds.size();
    for (int attempt = toFollow ? toFollow->attempt : 0; attempt < count; attempt++) {
        rough = &kinds[attempt];
        try {
            iterate(multiply, x, functions, result, measure, toFollow);
            course.attempt = attempt;
            return;
        } catch (const TooRough&) {
        }
    }
    rough = nullptr;
    iterate(multiply, x, functions, result, measure, toFollow);
    course.attempt = count;
}

void Lanczos::iterate(const Product& multiply, const MatrixXd& x,
                      const std::vector<SpectralFunction>& functions, MatrixXd& result,
                      Measure measure, const Course* toFollow) {
    isRough = rough && rough->atOnce;
    follows = toFollow;
    const int n = x.rows(), count = x.cols();
    result.setZero(n, count);
    columns.resize(count);
    int active = 0;
    for (int c = 0; c < count; c++) {
        start(columns[c], x.col(c));
        active += columns[c].active;
        if (toFollow) columns[c].nextLook = toFollow->products[c];
    }
    Course own;
    own.products.assign(count, 0);
    for (int k = 1; active > 0; k++) {
        input.resize(n, active);
        for (int c = 0, i = 0; c < count; c++)
            if (columns[c].active) input.col(i++) = columns[c].basis.col(k - 1);
        if (rough && toFollow && k <= static_cast<int>(toFollow->isRough.size()))
            isRough = toFollow->isRough[k - 1];
        own.isRough.push_back(isRough);
        (isRough ? rough->multiply : multiply)(input, output);
        numIterations++;
        numProducts += active;
        for (int c = 0, i = 0; c < count; c++)
            if (columns[c].active) extend(columns[c], output.col(i++));
        // Until the next products may be rough, every iterate is checked for that.
        const bool mayBecomeRough = rough && !isRough && !toFollow;
        const bool last = k >= maxIterations;
        const auto isDue = [&](const Column& column) {
            return column.active && (column.exact || last || k == column.nextLook);
        };
        for (int c = 0; c < count; c++)
            if (isDue(columns[c]) || (mayBecomeRough && columns[c].active))
                evaluate(columns[c], functions[c]);
        for (int c = 0; c < count; c++) {
            Column& column = columns[c];
            if (!isDue(column)) continue;
            if (isConverged(column, functions[c], measure, result)) {
                put(column, result, c);
                own.products[c] = k;
                column.active = false;
                active--;
            } else if (last) {
                if (isRough) throw TooRough();
                std::ostringstream message;
                message << "MobilityForce: after " << k
                        << " products the Lanczos iteration is at a relative error of "
                        << column.error << ", above " << toleranceText(tolerance, wanted)
                        << "; raise the tolerance (setSolverTolerance) or use the solver Dense";
                throw OpenMMException(message.str());
            }
        }
        if (mayBecomeRough)
            isRough = std::all_of(columns.begin(), columns.end(), [&](const Column& column) {
                return !column.active || allowsRoughProducts(column);
            });
    }
    course = own;
}

/** The error of a rough product with a vector of length 1. */
double Lanczos::errorOfRough(const Column& column) const {
    return rough ? rough->ofNorm * column.scale + rough->ofVector * column.first : 0;
}

/**
 * Errors of the products so far enter the result with factors that shrink about as fast as its
 * coefficients. The next products together therefore do not exceed a few times the effect of the
 * last one.
 */
bool Lanczos::allowsRoughProducts(const Column& column) const {
    const double ofLast = 0.25;  // the part of the last product
    const double share = ofLast * (rough->share > 0 ? rough->share : tolerance);
    const Iterate& iterate = column.iterate[column.form];
    return errorOfRough(column) * iterate.lastFactor <= share * iterate.norm;
}

void Lanczos::start(Column& column, const VectorXd& x) {
    column.norm = x.norm();
    if (!std::isfinite(column.norm))
        throw OpenMMException(
            "MobilityForce: a vector for the Lanczos iteration is not finite; look at the "
            "positions, forces and torques");
    column.alpha.clear();
    column.beta.clear();
    column.wasRough.clear();
    column.scale = 0;
    column.active = column.norm > 0;
    column.exact = false;
    column.nextLook = 3;  // before that, Ritz values say too little about the other eigenvalues
    column.lastLook = 0;
    column.form = Value;
    column.error = 0;
    column.before.resize(0);
    for (Iterate& iterate : column.iterate) iterate.coefficients.resize(0);
    const int atFirst = 32;
    if (column.basis.rows() != x.size())
        column.basis.resize(x.size(), std::min<int>(atFirst, x.size()));
    if (column.active) column.basis.col(0) = x / column.norm;
}

/** The next basis vector and the next row of the tridiagonal matrix. */
void Lanczos::extend(Column& column, const VectorXd& product) {
    const int k = column.alpha.size() + 1, n = product.size();
    VectorXd w = product;
    double alpha = 0;
    // Twice is enough: the second pass removes what rounding in the first left.
    for (int pass = 0; pass < 2; pass++) {
        overlap.noalias() = column.basis.leftCols(k).transpose() * w;
        w.noalias() -= column.basis.leftCols(k) * overlap;
        alpha += overlap[k - 1];
    }
    const double beta = w.norm();
    if (!std::isfinite(alpha + beta) && isRough) throw TooRough();
    if (!std::isfinite(alpha + beta))
        throw OpenMMException(
            "MobilityForce: a product with the mobility is not finite; look at the positions");
    column.alpha.push_back(alpha);
    column.scale = std::max(column.scale, std::abs(alpha) + beta);
    if (k == 1) column.first = std::hypot(alpha, beta);
    column.wasRough.push_back(isRough);
    column.exact =
        k == n || beta <= (isRough ? errorOfRough(column) : roundingError * column.scale);
    if (column.exact) return;
    column.beta.push_back(beta);
    if (column.basis.cols() == k) column.basis.conservativeResize(n, std::min(2 * k, n));
    column.basis.col(k) = w / beta;
}

/** f of the tridiagonal matrix. */
void Lanczos::evaluate(Column& column, const SpectralFunction& f) {
    const int k = column.alpha.size();
    // The matrix is scaled to about 1, as Eigen's test for zeros beside the diagonal assumes.
    Eigen::SelfAdjointEigenSolver<MatrixXd> solver;
    solver.computeFromTridiagonal(
        Eigen::Map<const VectorXd>(column.alpha.data(), k) / column.scale,
        Eigen::Map<const VectorXd>(column.beta.data(), k - 1) / column.scale);
    ritzValues = column.scale * solver.eigenvalues();
    column.smallest = ritzValues[0];
    column.largest = ritzValues[k - 1];
    if (solver.info() != Eigen::Success || !(column.smallest > 0)) {
        if (isRough) throw TooRough();
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
        slopes.resize(k, k);
        for (int i = 0; i < k; i++)
            for (int j = 0; j <= i; j++)
                slopes(i, j) = slopes(j, i) = slope(function, ritzValues[i], functionValues[i],
                                                    ritzValues[j], functionValues[j]);
        const double steepest =
            slopes.cwiseAbs().colwise().maxCoeff().transpose().cwiseProduct(firstRow).norm();
        // An error of the j-th product only changes what the j-th basis vector becomes.
        double ofRough = 0;
        for (int j = 0; j < k; j++) {
            weights = solver.eigenvectors().row(j).transpose().cwiseProduct(firstRow);
            iterate.lastFactor = (slopes * weights).cwiseAbs().maxCoeff();
            if (column.wasRough[j]) ofRough += iterate.lastFactor;
        }
        iterate.roundoff = roundingError * (column.scale * steepest + iterate.norm) +
                           errorOfRough(column) * std::min(ofRough, steepest);
        iterate.bound =
            column.exact
                ? 0
                : column.beta[k - 1] * largestFactor(function, functionValues, firstRow, lastRow,
                                                     column.beta[k - 1], column.basis.rows());
    }
    column.form = f.minusOne && column.iterate[Increment].norm < column.iterate[Value].norm
                      ? Increment
                      : Value;
}

/**
 * The error's component along an eigenvector u of A, of eigenvalue x, is exactly
 *
 *     beta_k (u.v_k+1) sum_i S_ki S_1i f[theta_i, x]
 *
 * with Ritz values theta and eigenvectors S of the tridiagonal matrix (compare f(A) v_1 with the
 * polynomial that takes f's values at theta). Between the extreme Ritz values, the largest
 * magnitude of this sum bounds the part of the error there, since v_k+1 has length 1. Beyond them
 * are few eigenvalues, and v_k+1 has only a small part along theirs. The squares of S's last row
 * are the parts of v_k along Ritz vectors, and a random vector of n rows has a part of 1/n along an
 * eigenvector. In v_k+1 either may be larger by a factor `growth`, where an eigenvalue has not been
 * found yet. How far eigenvalues reach beyond Ritz values comes from the residuals.
 */
double Lanczos::largestFactor(const std::function<double(double)>& f,
                              const VectorXd& functionValues, const VectorXd& firstRow,
                              const VectorXd& lastRow, double beta, int n) const {
    // An eigenvalue lies within one residual of each Ritz value, but the extreme eigenvalue may be
    // farther out. At first residuals say nothing yet; then `least` limits how far the interval
    // reaches towards zero.
    const double residuals = 3, least = 0.01, growth = 16;
    const int k = ritzValues.size();
    const double smallest = ritzValues[0], largest = ritzValues[k - 1];
    const double low =
        std::max(smallest - residuals * beta * std::abs(lastRow[0]), least * smallest);
    const double high = largest + residuals * beta * std::abs(lastRow[k - 1]);
    // The sum is smooth, and for most functions largest at an end.
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

/** T^-1 c, T positive definite with this diagonal and these numbers beside it. */
static VectorXd solveTridiagonal(const std::vector<double>& diagonal,
                                 const std::vector<double>& beside, const VectorXd& c) {
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

/**
 * Outer matrices make errors grow relative to the result. Those of products have no preferred
 * directions, like a basis vector. That of the iteration has the directions of the changes of
 * iterates.
 */
void Lanczos::magnify(Column& column) {
    Iterate& iterate = column.iterate[column.form];
    const VectorXd& y = iterate.coefficients;
    const int k = y.size();
    VectorXd change;
    if (column.before.size() > 0) {
        change = y;
        change.head(column.before.size()) -= column.before;
    }
    double ofErrors = 1, ofRounding = 1;
    for (const Outer& o : outer) {
        const auto growth = [&](const VectorXd& coefficients) {
            const double norm = coefficients.norm();
            if (!(norm > 0)) return 1.0;
            if (o.ofInverse)
                input.noalias() = column.basis.leftCols(k) *
                                  solveTridiagonal(column.alpha, column.beta, coefficients);
            else
                input.noalias() = column.basis.leftCols(coefficients.size()) * coefficients;
            o.multiply(input);
            return input.norm() / norm;
        };
        const double ofResult = growth(y);
        if (!(ofResult > 0)) continue;  // then nothing can be relative to it
        double ofProducts = ofResult;
        // The inverse is known up to the basis vector before the last.
        const int last = o.ofInverse ? k : k + 1;
        if (!column.exact)
            ofProducts = std::max(ofProducts, growth(VectorXd::Unit(last, last - 1)));
        double ofIteration = ofProducts;
        if (change.size() > 0) ofIteration = std::max(ofIteration, growth(change));
        ofErrors = std::max(ofErrors, ofIteration / ofResult);
        ofRounding = std::max(ofRounding, ofProducts / ofResult);
    }
    column.before = y;
    iterate.bound *= ofErrors;
    iterate.roundoff *= ofRounding;
}

bool Lanczos::isConverged(Column& column, const SpectralFunction& f, Measure measure,
                          MatrixXd& result) {
    // The error must be below five tolerances. This many of them are for the error of the iteration
    // (which the bound exceeds), this many for rounding, and the rest for the estimated interval of
    // the eigenvalues.
    // Where a course is followed, the matrix is another one, and the first apply() may have stopped
    // just below its limit. The limit is then twice as high, so that the number of products stays.
    const double shareOfIteration = follows ? 6 : 3, shareOfRounding = 1;
    // A result this much smaller than its vector counts as zero: squares of its elements underflow.
    const double nothing = 1e-140;
    if (!outer.empty()) magnify(column);
    const Iterate& iterate = column.iterate[column.form];
    // No bound can be smaller than the rounding error in computing it.
    const auto iterationConverged = [&](double norm) {
        return iterate.bound <= std::max(shareOfIteration * tolerance * norm, iterate.roundoff);
    };
    const auto roundingIsSmall = [&](double norm) {
        return iterate.roundoff <= shareOfRounding * tolerance * norm;
    };
    double norm = std::max(iterate.norm, nothing);
    if (measure == NormOfSum && f.minusOne && column.form == Value &&
        !(iterationConverged(norm) && roundingIsSmall(norm))) {
        for (int other = 0; other < static_cast<int>(columns.size()); other++)
            if (columns[other].active) put(columns[other], result, other);
        norm = std::max(norm, result.rowwise().sum().norm() / column.norm);
    }
    column.error = (iterate.bound + iterate.roundoff) / norm;
    if (!iterationConverged(norm)) {
        // Errors of the first products count most, so that more products do not help.
        if (isRough && rough->ofVector > 0 && !roundingIsSmall(norm)) throw TooRough();
        planNextLook(column, iterate.bound / (shareOfIteration * tolerance * norm));
        return false;
    }
    if (!roundingIsSmall(norm)) {
        if (isRough) throw TooRough();
        std::ostringstream message;
        message << "MobilityForce: " << toleranceText(tolerance, wanted)
                << " cannot be reached: rounding makes an error of " << column.error
                << " with a mobility whose eigenvalues go from " << column.smallest << " to "
                << column.largest
                << "; raise the tolerance (setSolverTolerance), or choose radii, masses and a step "
                   "size that make the eigenvalues more alike";
        throw OpenMMException(message.str());
    }
    return true;
}

/**
 * Plan the next check, which costs k^3 operations. Checks are rare while the error is far too
 * large, but in the end no iteration is one too many. In a large matrix a check takes far less time
 * than a product, and every iteration has one.
 *
 * @param excess  error over what is allowed
 */
void Lanczos::planNextLook(Column& column, double excess) const {
    const int k = column.alpha.size(), rowsOfLarge = 8 * k * k;
    int wait = column.basis.rows() > rowsOfLarge ? 1 : std::max(1, k / 4);
    // Errors shrink by about the same factor each iteration, later by more.
    const double rate = std::log(column.excess / excess) / (k - column.lastLook), share = 0.6;
    if (column.lastLook > 0 && rate > 0)
        wait = std::min<double>(wait, std::max(1.0, share * std::log(excess) / rate));
    column.lastLook = k;
    column.nextLook = k + wait;
    column.excess = excess;
}

/** Write the vector of the last iterate into a column. */
void Lanczos::put(const Column& column, MatrixXd& result, int c) const {
    const VectorXd& y = column.iterate[column.form].coefficients;
    result.col(c).noalias() = column.norm * (column.basis.leftCols(y.size()) * y);
}

}  // namespace RigidHIPlugin
