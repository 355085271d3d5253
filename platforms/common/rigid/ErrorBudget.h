#ifndef RIGIDHI_ERROR_BUDGET_H_
#define RIGIDHI_ERROR_BUDGET_H_

#include <vector>

#include "openmmrigidhi/SchemeTraits.h"
#include "rigid/BodyMobility.h"

namespace RigidHIPlugin {

/** What a scheme takes finite differences of in one group of bodies. */
struct Differencing {
    Differenced results = Differenced::Nothing;  // nothing also where the drift is known
    bool iterate = false;  // whether these results come from iterations, and so have a tolerance
    bool follow = false;   // whether they are roots that follow one course of iterations

    static Differencing of(const SchemeTraits& scheme, const BodyMobility& mobility,
                           bool driftIsKnown);
};

/** A product within an iteration that is not exact. */
struct InexactProduct {
    double error;  // as in MobilityAt::applyWithin()
    // As in Lanczos::Rough.
    double ofNorm, ofVector;
    bool atOnce;
    double share;
};

/**
 * How exact the iterations of a step are, and their products: what is left of the tolerance that
 * the user has set for each. There are no measured times. An error of 0 stands for exact products.
 *
 *   what                   error
 *   iterations             the tolerance, or the part of it that differences need
 *   products in roots      a tenth of the tolerance of iterations, then a hundredth; then those of
 *                          single precision, at once from MobilityAt::leastRoughTolerance on;
 *                          then none
 *   products in solves     what MultiblobSolver::errorFor() allows, but at least that of single
 *                          precision
 *   products as solves     a hundredth of the tolerance, where K = 1 and nobody differences them
 *   differences            a tenth of the tolerance
 *
 * Where iterations are differenced, none of their products are coarser than single precision,
 * because coarser errors jump from place to place. Where differences are small, all are exact
 * (BodyMobility::ForDifferences).
 */
class ErrorBudget {
public:
    /** @param tolerance  of the step, relative, as the user has set it */
    explicit ErrorBudget(double tolerance, const BodyMobility::ForDifferences& needed = {})
        : tolerance(tolerance), needed(needed) {}
    /** Where nobody has set the tolerance of a step: no coarse products. */
    static ErrorBudget beforeSteps(double tolerance);
    /** For the rest of a step whose differences have been taken. */
    static ErrorBudget afterDifferences(double tolerance);

    /** The finite-difference step where the user has set none, body lengths and radians. */
    static double differenceStep(double tolerance, const Differencing& differencing);
    /**
     * What the differences of a step need.
     *
     * @param step  of the differences
     */
    static BodyMobility::ForDifferences forDifferences(double tolerance,
                                                       const Differencing& differencing,
                                                       double step);

    /** The tolerance of iterations. */
    double ofIterations() const { return tolerance * needed.partOfTolerance; }
    /** The relative error of differences of products, which make drifts. */
    double ofDifferences() const;
    /** Whether products that are solves are differenced. */
    bool solvesAreDifferenced() const { return needed.differencedSolves; }
    /** Of products that are solves: where K = 1 nothing iterates. */
    double ofProductsAsSolves(const MobilityModel& model) const;
    /**
     * Of products within solves.
     *
     * @param mostUseful  the largest error with which a solve needs no exact products
     */
    double inSolves(const MobilityModel& model, double mostUseful) const;
    /**
     * The products that a Lanczos iteration tries before exact ones, in this order.
     *
     * @param amplification  of errors by the transformation of the matrix that iterates
     * @param ofVector       Lanczos::Rough::ofVector of products of single precision
     */
    std::vector<InexactProduct> inRoots(const MobilityModel& model, double amplification,
                                        double ofVector) const;
    /** The errors of the first products of iterations, for descriptions. */
    double firstInRoots(const MobilityModel& model, double amplification) const;
    double firstInSolves(const MobilityModel& model, double mostUseful) const;

private:
    std::vector<double> coarseInRoots(const MobilityModel& model, double amplification) const;
    double coarseInSolves(const MobilityModel& model, double mostUseful) const;
    bool allowsCoarse() const { return needed.coarseProducts && !needed.exactProducts; }
    bool allowsSinglePrecision() const;

    double tolerance;
    BodyMobility::ForDifferences needed;
};

}  // namespace RigidHIPlugin

#endif
