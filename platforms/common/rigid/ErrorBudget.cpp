#include "rigid/ErrorBudget.h"

#include <algorithm>

using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * The largest error of products in iterations. Errors of coarser products were up to four times as
 * large for the vectors of an iteration as for random forces, errors of finer ones at most as
 * large.
 */
const double coarsestError = 1e-3;

}  // namespace

ErrorBudget ErrorBudget::beforeSteps(double tolerance) {
    BodyMobility::ForDifferences needed;
    needed.coarseProducts = false;
    return ErrorBudget(tolerance, needed);
}

ErrorBudget ErrorBudget::afterDifferences(double tolerance) {
    BodyMobility::ForDifferences none;
    none.exactSolves = false;
    return ErrorBudget(tolerance, none);
}

double ErrorBudget::ofDifferences() const {
    const double part = 0.1, most = 1e-4;
    return min(most, part * tolerance);
}

double ErrorBudget::ofProductsAsSolves(const MobilityModel& model) const {
    // The tolerance is in the norm of the friction. In this norm errors of products were up to a
    // hundred times as large.
    const double error = 0.01 * ofIterations();
    return !needed.exactSolves && model.hasFastProducts(error) ? error : 0;
}

double ErrorBudget::coarseInSolves(const MobilityModel& model, double mostUseful) const {
    const double error = min(coarsestError, mostUseful);
    const bool isWorthIt = error > MobilityAt::roughError && model.hasFastProducts(error);
    return allowsCoarse() && isWorthIt ? error : 0;
}

double ErrorBudget::inSolves(const MobilityModel& model, double mostUseful) const {
    if (needed.exactProducts) return 0;
    return max(coarseInSolves(model, mostUseful), MobilityAt::roughError);
}

vector<double> ErrorBudget::coarseInRoots(const MobilityModel& model, double amplification) const {
    vector<double> errors;
    if (!allowsCoarse()) return errors;
    // With a tenth of the tolerance the estimate of what such products do to a result rarely
    // exceeds what is allowed; a hundredth is for badly conditioned matrices.
    for (double part : {0.1, 0.01}) {
        const double error = min(coarsestError, part * ofIterations() / amplification);
        if (error >= MobilityAt::roughError && model.hasFastProducts(error))
            errors.push_back(error);
    }
    return errors;
}

bool ErrorBudget::allowsSinglePrecision() const {
    return ofIterations() >= MobilityAt::leastRoughTolerance;
}

vector<InexactProduct> ErrorBudget::inRoots(const MobilityModel& model, double amplification,
                                            double ofVector) const {
    vector<InexactProduct> products;
    for (double error : coarseInRoots(model, amplification))
        products.push_back({error, 0, amplification * error, true, 0});
    if (!model.hasRoughProducts()) return products;
    const double single = MobilityAt::roughError;
    if (!needed.exactProducts)
        products.push_back({single, single, ofVector, allowsSinglePrecision(), 0});
    else if (needed.shareOfRough > 0)
        products.push_back({single, single, ofVector, false, needed.shareOfRough});
    return products;
}

double ErrorBudget::firstInRoots(const MobilityModel& model, double amplification) const {
    const vector<double> coarse = coarseInRoots(model, amplification);
    if (!coarse.empty()) return coarse[0];
    return allowsSinglePrecision() ? MobilityAt::roughError : 0;
}

double ErrorBudget::firstInSolves(const MobilityModel& model, double mostUseful) const {
    return max(coarseInSolves(model, mostUseful),
               allowsSinglePrecision() ? MobilityAt::roughError : 0);
}

}  // namespace RigidHIPlugin
