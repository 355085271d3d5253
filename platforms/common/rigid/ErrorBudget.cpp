#include "rigid/ErrorBudget.h"

#include <algorithm>
#include <cmath>

#include "mobility/InnerErrors.h"
#include "rigid/BodyMobility.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * The largest error of products in iterations. Models state errors for random forces. With larger
 * errors than this, the errors for the vectors of an iteration were up to four times as large as
 * stated; with smaller ones they never were larger.
 */
const double largestError = 1e-3;

/**
 * The default of setFiniteDifferenceStep(). It balances rounding of 1e-16 and the error of the
 * difference.
 */
const double denseDifference = 1e-5;

/**
 * The limit of the step where solves with a tolerance t are differenced. The difference then has an
 * error of t/step in addition to step^2, so the step is t^(1/3). The limit keeps bodies in the
 * neighbourhood in which the mobility is smooth. Until the step has taken its differences,
 * iterations go to a part of the tolerance.
 */
const double largestDifference = 1e-2;

/**
 * Differences of roots that follow one course (Lanczos::apply()) have an error that does not depend
 * on the step. In units of the iteration's tolerance this error grows about as the square of the
 * number of products; up to 120 was measured (TestLanczos). For drifts such a difference needs a
 * relative error of `enoughForDrifts` only.
 */
const double errorOfFollowing = 100, enoughForDrifts = 1e-4;

/** Products that reduce a residual by less than this are not worth the exact ones. */
const double leastReduction = 0.1;

/**
 * With collective modes, errors of products of single precision are errors of S; they are not
 * relative to the norm of S'. Terms of a sum have independent errors, which are relative to
 * products with a vector that has no preferred direction.
 */
const double termsOfModes = 3;

}  // namespace

Differencing Differencing::of(const SchemeTraits& scheme, const BodyMobility& mobility,
                              bool driftIsKnown) {
    Differencing found;
    if (driftIsKnown) return found;
    found.results = scheme.differenced;
    switch (scheme.differenced) {
        case Differenced::Nothing: break;
        case Differenced::Products: found.iterate = mobility.productsIterate(); break;
        case Differenced::Solves: found.iterate = mobility.solvesIterate(); break;
        case Differenced::Roots:
            // The divergence of a random field needs no differences of roots.
            found.iterate = mobility.rootsIterate() && !mobility.field().knowsDivergence();
            found.follow =
                found.iterate && !mobility.productsIterate() && !mobility.field().givesSlips();
            break;
    }
    return found;
}

double ErrorBudget::differenceStep(double tolerance, const Differencing& differencing) {
    if (!differencing.iterate) return denseDifference;
    // Where products may be of single precision at once, small differences would need exact ones.
    if (differencing.follow && tolerance < Accuracy::leastToleranceOfSinglePrecision)
        return denseDifference;
    return min(largestDifference, max(denseDifference, cbrt(tolerance)));
}

ErrorBudget ErrorBudget::ofDifferencing(double tolerance, const Differencing& differencing,
                                        double step) {
    Needs needed;
    needed.largeErrors = !differencing.iterate;
    needed.exactSolves = differencing.results != Differenced::Nothing;
    needed.differencedSolves = differencing.results == Differenced::Solves;
    if (!differencing.iterate) return ErrorBudget(tolerance, needed);
    needed.exactProducts = step < largestDifference;
    needed.partOfTolerance = InnerErrors::ofDifferences;
    if (!differencing.follow) return ErrorBudget(tolerance, needed);
    needed.partOfTolerance =
        max(InnerErrors::ofDifferences, min(1.0, enoughForDrifts / (errorOfFollowing * tolerance)));
    // Rounding may change the difference as much as the tolerance does.
    needed.shareOfInexact = errorOfFollowing * needed.partOfTolerance * tolerance * step;
    return ErrorBudget(tolerance, needed);
}

ErrorBudget ErrorBudget::afterDifferences() const {
    Needs none;
    none.exactSolves = false;
    return ErrorBudget(tolerance, none);
}

ErrorBudget ErrorBudget::ofRelaxation(double tolerance, bool iterate) {
    // Products that are iterations themselves have this part of the tolerance. Other products have
    // the errors that the tolerance itself allows.
    const double inner = 0.05;
    if (iterate) return ErrorBudget(inner * tolerance);
    Needs needed;
    needed.partOfTolerance = inner;
    return ErrorBudget(tolerance, needed);
}

ErrorBudget ErrorBudget::beforeSteps(double tolerance) {
    Needs needed;
    needed.largeErrors = false;
    return ErrorBudget(tolerance, needed);
}

Accuracy ErrorBudget::ofDifferences() const {
    const double part = 0.1, most = 1e-4;
    return {min(most, part * tolerance), Accuracy::Difference};
}

bool ErrorBudget::savesTime(const MobilityModel& model, double error) {
    // On the host, rounding to floats saves little time in a single product.
    const bool isSingle =
        model.getTraits().hasFastSinglePrecision && error >= Accuracy::errorOfSinglePrecision;
    return isSingle || model.hasFastProducts(error);
}

Accuracy ErrorBudget::ofProductsAsSolves(const MobilityModel& model) const {
    // The tolerance is in the norm of the friction. In this norm errors of products were up to a
    // hundred times as large.
    const double error = 0.01 * ofIterations();
    return {!needed.exactSolves && savesTime(model, error) ? error : 0, Accuracy::Value};
}

double ErrorBudget::largeInSolves(const MobilityModel& model, double mostUseful) const {
    const double error = min(largestError, mostUseful);
    const bool isWorthIt = error > Accuracy::errorOfSinglePrecision && model.hasFastProducts(error);
    return allowsLargeErrors() && isWorthIt ? error : 0;
}

double ErrorBudget::inSolves(const MobilityModel& model, double mostUseful) const {
    if (needed.exactProducts) return 0;
    return max(largeInSolves(model, mostUseful), Accuracy::errorOfSinglePrecision);
}

double ErrorBudget::reductionBy(double error, double growth) {
    return error * max(growth, Accuracy::leastToleranceOfSinglePrecision /
                                   Accuracy::errorOfSinglePrecision);
}

vector<double> ErrorBudget::attemptsOfSolve(double error, double growth, bool hasSinglePrecision) {
    vector<double> errors;
    if (hasSinglePrecision)
        for (double inexact : {error, Accuracy::errorOfSinglePrecision})
            if (inexact > 0 && inexact <= error && growth * inexact < leastReduction &&
                (errors.empty() || inexact < errors.back()))
                errors.push_back(inexact);
    errors.push_back(0);
    return errors;
}

vector<double> ErrorBudget::largeInRoots(const MobilityModel& model, double amplification) const {
    vector<double> errors;
    if (!allowsLargeErrors()) return errors;
    // With a tenth of the tolerance, the estimated effect of such products on a result rarely
    // exceeds the allowed error; a hundredth is for badly conditioned matrices.
    for (double part : {0.1, 0.01}) {
        const double error = min(largestError, part * ofIterations() / amplification);
        if (error >= Accuracy::errorOfSinglePrecision && model.hasFastProducts(error))
            errors.push_back(error);
    }
    return errors;
}

bool ErrorBudget::startsInSinglePrecision() const {
    return ofIterations() >= Accuracy::leastToleranceOfSinglePrecision;
}

vector<InexactProduct> ErrorBudget::inRoots(const MobilityModel& model, double amplification,
                                            bool hasModes) const {
    vector<InexactProduct> products;
    const double ofVector = hasModes ? termsOfModes * Accuracy::errorOfSinglePrecision : 0;
    for (double error : largeInRoots(model, amplification))
        products.push_back({error, 0, amplification * error, true, 0});
    if (!model.getTraits().hasSinglePrecision) return products;
    const double single = Accuracy::errorOfSinglePrecision;
    if (!needed.exactProducts)
        products.push_back({single, single, ofVector, startsInSinglePrecision(), 0});
    else if (needed.shareOfInexact > 0)
        products.push_back({single, single, ofVector, false, needed.shareOfInexact});
    return products;
}

double ErrorBudget::firstInRoots(const MobilityModel& model, double amplification) const {
    const vector<InexactProduct> products = inRoots(model, amplification);
    return !products.empty() && products[0].atOnce ? products[0].error : 0;
}

double ErrorBudget::firstInSolves(const MobilityModel& model, double mostUseful) const {
    return model.getTraits().hasSinglePrecision ? inSolves(model, mostUseful) : 0;
}

}  // namespace RigidHIPlugin
