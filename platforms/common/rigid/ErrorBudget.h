#ifndef RIGIDHI_ERROR_BUDGET_H_
#define RIGIDHI_ERROR_BUDGET_H_

#include <vector>

#include "linearalgebra/Lanczos.h"
#include "mobility/MobilityModel.h"
#include "openmmrigidhi/SchemeTraits.h"

namespace RigidHIPlugin {

class BodyMobility;

/** What a scheme takes finite differences of in one group of bodies. */
struct Differencing {
    Differenced results = Differenced::Nothing;  // nothing also where the drift is known
    bool iterate = false;  // whether these results come from iterations, and so have a tolerance
    bool follow = false;   // whether they are roots that follow one course of iterations

    static Differencing of(const SchemeTraits& scheme, const BodyMobility& mobility,
                           bool driftIsKnown);
};

/**
 * Which error each product and each iteration of a step may have: what is left of the tolerance
 * that the user has set. It is the only place that decides this. There are no measured times. An
 * error of 0 stands for exact products.
 *
 *   what                   error
 *   iterations             the tolerance, or the part of it that differences need
 *   products in roots      a tenth of the tolerance of iterations, then a hundredth; then those of
 *                          single precision, at once from
 *                          Accuracy::leastToleranceOfSinglePrecision on; then none
 *   products in solves     what MultiblobSolver::errorFor() allows, but at least that of single
 *                          precision
 *   products as solves     a hundredth of the tolerance, where K = 1 and nobody differences them,
 *                          if the model has faster products of such an error
 *   differences            a tenth of the tolerance
 *   roots of grids         Accuracy::partForDifferences of the tolerance (RotnePragerYamakawaGrid)
 *
 * Where iterations are differenced, none of their products have larger errors than those of single
 * precision, because larger errors jump from place to place. Where differences are small, all
 * products are exact (Needs).
 */
class ErrorBudget {
public:
    /** What finite differences need of the results that they are taken of. */
    struct Needs {
        /** Iterations go to this part of the tolerance. */
        double partOfTolerance = 1;
        /**
         * Exact products within iterations: small differences would magnify rounding of single
         * precision.
         */
        bool exactProducts = false;
        /**
         * With exact products, errors of the last products of a root may still make this part of
         * it. 0: all are exact.
         */
        double shareOfInexact = 0;
        /**
         * Products within iterations may have larger errors than those of single precision, as the
         * tolerance allows. Results of iterations that are differenced must not have such products,
         * because their errors jump from place to place.
         */
        bool largeErrors = true;
        /**
         * Where nothing iterates, BodyMobility::solve() has exact products. Otherwise its products
         * are right to a part of the tolerance.
         */
        bool exactSolves = true;
        /** Then, whether these products are differenced. */
        bool differencedSolves = false;
    };

    /** @param tolerance  of the step, relative, as the user has set it */
    explicit ErrorBudget(double tolerance) : tolerance(tolerance) {}
    ErrorBudget(double tolerance, const Needs& needed) : tolerance(tolerance), needed(needed) {}
    /** Of a step without momenta, whose differences have this step. */
    static ErrorBudget ofDifferencing(double tolerance, const Differencing& differencing,
                                      double step);
    /** For the rest of such a step, when its differences have been taken. */
    ErrorBudget afterDifferences() const;
    /**
     * Of the Ornstein-Uhlenbeck process of momenta, whose own iteration has the tolerance.
     *
     * @param iterate  whether its products are iterations themselves: solves of multiblobs
     */
    static ErrorBudget ofRelaxation(double tolerance, bool iterate);
    /** Where nobody has set the tolerance of a step: no errors above those of single precision. */
    static ErrorBudget beforeSteps(double tolerance);

    /** The finite-difference step where the user has set none, body lengths and radians. */
    static double differenceStep(double tolerance, const Differencing& differencing);

    /** Of the step. */
    double getTolerance() const { return tolerance; }
    const Needs& getNeeds() const { return needed; }
    /** The tolerance of iterations. */
    double ofIterations() const { return tolerance * needed.partOfTolerance; }
    /** Of differences of products, which make drifts. */
    Accuracy ofDifferences() const;
    /** Whether products that are solves are differenced. */
    bool solvesAreDifferenced() const { return needed.differencedSolves; }
    /** Whether a model takes less time for a single product of such an error than for an exact one,
     * so much that it should. */
    static bool savesTime(const MobilityModel& model, double error);
    /** Of products that are solves: where K = 1 nothing iterates. */
    Accuracy ofProductsAsSolves(const MobilityModel& model) const;
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
     * @param ofVector       InexactProduct::ofVector of products of single precision
     */
    std::vector<InexactProduct> inRoots(const MobilityModel& model, double amplification,
                                        double ofVector) const;
    /** The errors of the first products of iterations, for descriptions. */
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
