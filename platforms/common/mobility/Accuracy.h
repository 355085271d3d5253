#ifndef RIGIDHI_ACCURACY_H_
#define RIGIDHI_ACCURACY_H_

namespace RigidHIPlugin {

/**
 * The accuracy that a product with a mobility needs, and the purpose of the product. By default the
 * product is exact.
 *
 * Models use it to choose the product that takes the least time. ErrorBudget (rigid/) says which
 * accuracy each product of a step needs.
 */
struct Accuracy {
    enum Purpose {
        Value,      // the caller uses the product itself, or iterates with it
        Difference  // the caller subtracts it from a product at a nearby placement
    };
    /**
     * Value: the error is at most this times the norm of M times the norm of the forces. Both norms
     * scale M and forces by the square roots of the particles' own mobilities. Difference: the
     * difference of both products has about this relative error, and the error is continuous from
     * one placement to the other. 0: the product is exact, except for rounding.
     */
    double error = 0;
    Purpose purpose = Value;

    /**
     * The error of products in single precision, and the smallest tolerance of an iteration for
     * which they are accurate enough from the first product on.
     */
    static constexpr double errorOfSinglePrecision = 1e-6, leastToleranceOfSinglePrecision = 5e-5;
    /**
     * Whether the product may use single precision. Differences may not, because its rounding
     * errors jump from one placement to the next.
     */
    bool allowsSinglePrecision() const {
        return purpose == Value && error >= errorOfSinglePrecision;
    }
};

}  // namespace RigidHIPlugin

#endif
