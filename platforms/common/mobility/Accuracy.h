#ifndef RIGIDHI_ACCURACY_H_
#define RIGIDHI_ACCURACY_H_

namespace RigidHIPlugin {

/**
 * How exact a product with a mobility has to be, and what it is for. By default it is exact.
 *
 * Models use it to choose the product that takes the least time. ErrorBudget (rigid/) says which
 * accuracy each product of a step needs.
 */
struct Accuracy {
    enum Purpose {
        Value,      // the product itself is used, or an iteration is built on it
        Difference  // it is subtracted from a product at a nearby placement
    };
    /**
     * Value: the error is at most this times the norm of M times the norm of the forces. M and
     * forces are scaled by the square roots of the particles' own mobilities in both norms.
     * Difference: the difference of both products has about this relative error, and errors do not
     * jump from one placement to the other. 0: the product is exact, except for rounding.
     */
    double error = 0;
    Purpose purpose = Value;

    /**
     * The error of products in single precision, and the smallest tolerance of an iteration for
     * which they are accurate enough from the first product on.
     */
    static constexpr double errorOfSinglePrecision = 1e-6, leastToleranceOfSinglePrecision = 5e-5;
    /** Iterations whose results are differenced, to find drifts, go to this part of the tolerance.
     */
    static constexpr double partForDifferences = 0.1;
    /** Rounding of single precision would jump from placement to placement. */
    bool allowsSinglePrecision() const {
        return purpose == Value && error >= errorOfSinglePrecision;
    }
};

}  // namespace RigidHIPlugin

#endif
