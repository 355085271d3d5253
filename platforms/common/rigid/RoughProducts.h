#ifndef RIGIDHI_ROUGH_PRODUCTS_H_
#define RIGIDHI_ROUGH_PRODUCTS_H_

#include <vector>

#include "linearalgebra/Lanczos.h"
#include "mobility/MobilityAt.h"
#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * The largest error of products in iterations. Errors of coarser products were up to four times as
 * large for the vectors of an iteration as for random forces, errors of finer ones at most as
 * large.
 */
constexpr double coarsestError = 1e-3;

/**
 * The errors of fast products that a Lanczos iteration should try, in this order. With a tenth of
 * the tolerance the estimate of what they do to a result rarely exceeds what is allowed; a
 * hundredth is for badly conditioned matrices.
 *
 * @param amplification  of errors by the transformation of the matrix that iterates
 */
inline std::vector<double> coarseErrors(const MobilityModel& model, double tolerance,
                                        double amplification) {
    std::vector<double> errors;
    for (double part : {0.1, 0.01}) {
        const double error = std::min(coarsestError, part * tolerance / amplification);
        if (error >= MobilityAt::roughError && model.hasFastProducts(error))
            errors.push_back(error);
    }
    return errors;
}

/**
 * The rough products of a model for a Lanczos iteration: fast ones that are as coarse as the
 * tolerance allows, then those of single precision.
 *
 * @param coarse   whether there may be fast ones, see BodyMobility::ForDifferences
 * @param ofVector  Lanczos::Rough::ofVector of products of single precision
 * @param product  product(error) is a Lanczos::Product with MobilityAt::applyWithin(error)
 */
template <class MakeProduct>
std::vector<Lanczos::Rough> roughProducts(const MobilityModel& model, double tolerance, bool coarse,
                                          double amplification, double ofVector,
                                          const MakeProduct& product) {
    std::vector<Lanczos::Rough> rough;
    if (coarse)
        for (double error : coarseErrors(model, tolerance, amplification))
            rough.push_back({product(error), 0, amplification * error, true});
    if (model.getTraits().hasRoughProducts)
        rough.push_back({product(MobilityAt::roughError), MobilityAt::roughError, ofVector,
                         tolerance >= MobilityAt::leastRoughTolerance});
    return rough;
}

}  // namespace RigidHIPlugin

#endif
