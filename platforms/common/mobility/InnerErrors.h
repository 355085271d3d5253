#ifndef RIGIDHI_INNER_ERRORS_H_
#define RIGIDHI_INNER_ERRORS_H_

#include <algorithm>

namespace RigidHIPlugin {

/**
 * The errors that models may have in iterations and products of their own, as parts of the error
 * that their caller allows. ErrorBudget (rigid/) decides what callers allow. How a grid or a sum
 * divides the error of one product between its parts is a matter of the model's formulas
 * (EwaldSplitting, GridResolution).
 *
 *   what                                    error
 *   products that are iterations            that of the caller, but at least `least`
 *   residuals of these iterations           `residualsOf...` times that of the product
 *   bounds of their errors                  `boundBySingularValues` times that of the product
 *   products in iterations for stresslets   `ofProductsForStresslets` times that of the product
 *   roots that random fields consist of     `ofDifferences` times the tolerance, since schemes
 *                                           subtract them
 *   answers to users' questions             `ofAnswers` times the tolerance
 */
struct InnerErrors {
    /** Exact products that are iterations have this relative error. */
    static constexpr double least = 1e-11;
    static double ofIteration(double error) { return std::max(error, least); }
    /**
     * The tolerance of iterations whose results are subtracted to find drifts, as a part of the
     * usual tolerance.
     */
    static constexpr double ofDifferences = 0.1;
    /** The error of stresslets, and of what users ask for beside a step. */
    static constexpr double ofAnswers = 0.1;
    /**
     * The preconditioned residual was at least this part of the error: for stresslets
     * (StokesianDynamicsGrid), and for velocities with lubrication on top of a model
     * (LubricatedMobility), where it was 0.13 in suspensions of spheres at a volume fraction of
     * 0.45 with gaps of a thousandth of a radius.
     */
    static constexpr double residualsOfStresslets = 1.0 / 3, residualsOfLubrication = 0.12;
    /**
     * Bounds of errors by the smallest singular value (Gmres::ErrorBound) may be this many times
     * the error that the caller allows. They were 1.5 times the error in such suspensions, and up
     * to 12 times in crystals of spheres that nearly touch.
     */
    static constexpr double boundBySingularValues = 3;
    /**
     * Relative to the small eigenvalues of M, for motions of spheres against each other, errors of
     * products are up to a hundred times as large as stated.
     */
    static constexpr double ofProductsForStresslets = 0.01;
    /**
     * This part of the tolerance is added to own mobilities where random velocities take the root
     * of a mobility of pairs. Without it, neglected pairs could leave slightly negative
     * eigenvalues, within the tolerance.
     */
    static constexpr double ofOwnMobilities = 0.3;
};

}  // namespace RigidHIPlugin

#endif
