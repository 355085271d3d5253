#ifndef RIGIDHI_ERROR_BUDGET_H_
#define RIGIDHI_ERROR_BUDGET_H_

#include <vector>

#include "linearalgebra/Lanczos.h"
#include "mobility/MobilityModel.h"
#include "openmmrigidhi/SchemeTraits.h"

namespace RigidHIPlugin {

class BodyMobility;

/** The results that a scheme takes finite differences of, in one group of bodies. */
struct Differencing {
    Differenced results = Differenced::Nothing;  // Nothing also if the drift is known
    bool iterate = false;  // whether these results come from iterations, and so have a tolerance
    bool follow = false;   // whether they are roots that follow one course of iterations

    static Differencing of(const SchemeTraits& scheme, const BodyMobility& mobility,
                           bool driftIsKnown);
};

/**
 * The error that each product and each iteration of a step may have, as parts of the tolerance that
 * the user has set. No other class decides this, and no decision depends on measured times. An
 * error of 0 stands for exact products. Iterations within a model divide the error of their product
 * further: InnerErrors (mobility/).
 *
 *   what                   error
 *   iterations             the tolerance, or the part of it that differences need
 *   products in roots      a tenth of the tolerance of iterations, then a hundredth; then those of
 *                          single precision, at once from
 *                          Accuracy::leastToleranceOfSinglePrecision on; then none
 *   products in solves     what MultiblobSolver::errorFor() allows, but at least that of single
 *                          precision; then that of single precision; then none
 *   products as solves     a hundredth of the tolerance, where K = 1 and nobody differences them,
 *                          if the model has faster products of such an error
 *   differences            a tenth of the tolerance
 *   roots of grids         InnerErrors::ofDifferences of the tolerance (RotnePragerYamakawaGrid,
 *                          ConfinedRotnePragerYamakawaGrid)
 *
 * Where results of iterations are differenced, no product of these iterations has a larger error
 * than in single precision, because larger errors jump from place to place. Where differences are
 * small, all products are exact (Needs).
 */
class ErrorBudget {
public:
    /** The requirements of finite differences on the results that they are taken of. */
    struct Needs {
        /** Iterations go to this part of the tolerance. */
        double partOfTolerance = 1;
        /**
         * Products within iterations are exact, because small differences would magnify rounding of
         * single precision.
         */
        bool exactProducts = false;
        /**
         * With exact products, the last products of a root may still have errors that amount to
         * this part of the root. 0: all products are exact.
         */
        double shareOfInexact = 0;
        /**
         * Products within iterations may have larger errors than those of single precision, as the
         * tolerance allows. Where results of iterations are differenced, this is false, because
         * such errors jump from place to place.
         */
        bool largeErrors = true;
        /**
         * Where nothing iterates, BodyMobility::solve() has exact products. Otherwise its products
         * are right to a part of the tolerance.
         */
        bool exactSolves = true;
        /** Without exact solves: whether the products of solves are differenced. */
        bool differencedSolves = false;
    };

    /** @param tolerance  of the step, relative, as the user has set it */
    explicit ErrorBudget(double tolerance) : tolerance(tolerance) {}
    ErrorBudget(double tolerance, const Needs& needed) : tolerance(tolerance), needed(needed) {}
    /**
     * The budget of a step without momenta.
     *
     * @param step  the finite-difference step
     */
    static ErrorBudget ofDifferencing(double tolerance, const Differencing& differencing,
                                      double step);
    /** The budget for the rest of such a step, after its differences. */
    ErrorBudget afterDifferences() const;
    /**
     * The budget of the Ornstein-Uhlenbeck process of momenta. The iteration of the process itself
     * has the tolerance.
     *
     * @param iterate  whether its products are iterations themselves: solves of multiblobs
     */
    static ErrorBudget ofRelaxation(double tolerance, bool iterate);
    /** The budget before the first step: no errors above those of single precision. */
    static ErrorBudget beforeSteps(double tolerance);

    /** The default finite-difference step, in body lengths and radians. */
    static double differenceStep(double tolerance, const Differencing& differencing);

    /** The tolerance of the step. */
    double getTolerance() const { return tolerance; }
    const Needs& getNeeds() const { return needed; }
    /** The tolerance of iterations. */
    double ofIterations() const { return tolerance * needed.partOfTolerance; }
    /** The accuracy of differences of products for drifts. */
    Accuracy ofDifferences() const;
    /** Whether products that are solves are differenced. */
    bool solvesAreDifferenced() const { return needed.differencedSolves; }
    /**
     * Whether a single product with this error saves the model enough time, compared with an exact
     * product, to be worth its error.
     */
    static bool savesTime(const MobilityModel& model, double error);
    /** The accuracy of products that are solves themselves, where K = 1 and nothing iterates. */
    Accuracy ofProductsAsSolves(const MobilityModel& model) const;
    /**
     * The error of products within solves.
     *
     * @param mostUseful  the largest error with which a solve needs no exact products
     */
    double inSolves(const MobilityModel& model, double mostUseful) const;
    /**
     * The products that a Lanczos iteration tries before exact ones, in this order.
     *
     * @param amplification  factor by which the transformation of the iterated matrix magnifies
     *     errors
     * @param hasModes       whether CollectiveModes transform the iterated matrix. Products of
     *     single precision then have errors relative to the vector (InexactProduct::ofVector)
     */
    std::vector<InexactProduct> inRoots(const MobilityModel& model, double amplification,
                                        bool hasModes = false) const;
    /**
     * The factor by which products of this error can reduce a residual of a solve before it has to
     * be computed anew.
     *
     * @param growth  of errors of products in the energy norm, at most
     */
    static double reductionBy(double error, double growth);
    /**
     * The errors of products that a solve tries one after the other. The last is 0.
     *
     * @param error  of the first attempt (inSolves())
     */
    static std::vector<double> attemptsOfSolve(double error, double growth,
                                               bool hasSinglePrecision);
    /** The errors of the first products of roots and of solves, for descriptions. */
    double firstInRoots(const MobilityModel& model, double amplification) const;
    double firstInSolves(const MobilityModel& model, double mostUseful) const;

private:
    std::vector<double> largeInRoots(const MobilityModel& model, double amplification) const;
    double largeInSolves(const MobilityModel& model, double mostUseful) const;
    bool allowsLargeErrors() const { return needed.largeErrors && !needed.exactProducts; }
    bool startsInSinglePrecision() const;

    double tolerance;
    Needs needed;
};

}  // namespace RigidHIPlugin

#endif
