#ifndef RIGIDHI_SLOWED_SPIN_H_
#define RIGIDHI_SLOWED_SPIN_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * A slowed rotation of a body about its fastest axis, for bodies that spin faster than a step of a
 * scheme without momenta resolves.
 *
 * A step turns a body by one rotation vector. Let v_k = 2 kT h mu_k be the variance of its
 * component along axis k, with mu_1 >= mu_2 >= mu_3 the rotational mobilities of the body alone,
 * and v_2 = v_3. To first order, axis 1 then tumbles at 1 + (2 v_2 - v_1)/12 times the right rate
 * (docs/theory/details_of_steps.md). A body that is straight to the decimals of its file has
 * mu_1/mu_2 up to 1e9, so that v_1 is huge and steps lose the tumbling of axis 1.
 *
 * Equation:  N = N_rest + mu_1 t t^T, where t = N e_1/mu_1 is the screw (twist) that a torque about
 *            axis 1 causes, and N_rest e_1 = 0. Let t = s + p, where p is the advance of the screw
 *            along axis 1 and s turns about the axis. The step uses N' = N_rest + mu_1 t' t'^T, t'
 *            = factor s + p, in place of N. This means N' = B N B^T with B = 1 - (1 - factor) s
 *            e_1^T, where B turns with the body. For particles K' = K B^-1, B^-1 = 1 + (1/factor -
 *            1) s e_1^T.
 * Limits:    averages over configurations stay right, as with any positive definite mobility. A
 *            fast spin averages the motion of the rest of the body over angles about axis 1,
 *            whatever its rate is. Only the angle itself diffuses more slowly, and forces turn the
 *            body more slowly about axis 1.
 */
struct SlowedSpin {
    using Vector6d = Eigen::Matrix<double, 6, 1>;
    using Matrix6d = Eigen::Matrix<double, 6, 6>;

    Eigen::Vector3d axis = Eigen::Vector3d::Zero();  // e_1, body frame
    Vector6d screw = Vector6d::Zero();               // s = (V, W), body frame, with W = e_1
    double advance = 0;                              // p = advance (e_1, 0), nm
    double factor = 1;                               // 1: the spin is not slowed

    bool isSlowed() const { return factor < 1; }
    bool operator==(const SlowedSpin& other) const {
        return axis == other.axis && screw == other.screw && factor == other.factor;
    }
    /** t', body frame: the twist that a torque about axis 1 causes, over mu_1. */
    Vector6d slowedScrew() const;
    /** B, body frame. */
    Matrix6d congruence() const;
    /** B N B^T, body frame. */
    Matrix6d slow(const Matrix6d& mobility) const;
};

/** Which spins a scheme slows, and to which variance in a step. */
struct SpinBounds {
    /** Spins with variances below this are not slowed, rad^2. */
    double resolved;
    /** Other spins are slowed to the larger of `target` and `ratio` v_2, rad^2. */
    double target, ratio;
};
/**
 * A body with mu_1 < 3 mu_2 keeps its spin: with v_1 = 3 v_2 the error of tumbling, (2 v_2 -
 * v_1)/12, is that of a sphere with the other sign. Spins of up to half a radian keep their rate;
 * the rate of tumbling then has an error of 2 %. Other spins are slowed to a fifth of a radian, so
 * that steps remain stable where forces hold the angle with a stiffness of up to 2/0.02 kT/rad^2.
 */
constexpr double leastSpinRatio = 3;
constexpr SpinBounds boundsOfStart = {0.25, 0.04, leastSpinRatio};
/**
 * If a scheme takes its noise at the start and its mobility at the mid-point, spin causes a
 * relative error of tumbling of 1.2 (v_1 - v_2) (measured; docs/theory/details_of_steps.md).
 */
constexpr SpinBounds boundsOfMidpoint = {0.02, 0.02, 1};

/** The two largest rotational mobilities of a body, and its slowed spin in a step. */
struct BodyRotation {
    double fastest = 0, second = 0;  // mu_1, mu_2
    SlowedSpin spin;
    /** The fastest mobility of the step. */
    double fastestInStep() const { return spin.factor * spin.factor * fastest; }
    /** The longest step that does not slow the spin, ps. */
    double longestStep(double kT, const SpinBounds& bounds) const {
        return bounds.resolved / (2 * kT * fastest);
    }
};

/**
 * @param mobility      6 x 6, of the body alone, body frame
 * @param doubleEnergy  2 kT h, kJ ps/mol; 0: nothing is slowed
 */
BodyRotation findRotation(const Eigen::MatrixXd& mobility, double doubleEnergy,
                          const SpinBounds& bounds = boundsOfStart);

}  // namespace RigidHIPlugin

#endif
