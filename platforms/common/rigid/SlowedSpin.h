#ifndef RIGIDHI_SLOWED_SPIN_H_
#define RIGIDHI_SLOWED_SPIN_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * The rotation of a body about its fastest axis, slowed to what a step of a scheme without momenta
 * resolves.
 *
 * A step turns a body by one rotation vector. Let v_k = 2 kT h mu_k be the variance of its
 * component along axis k, with mu_1 >= mu_2 >= mu_3 the rotational mobilities of the body alone,
 * and v_2 = v_3. To first order axis 1 then tumbles at the right rate times 1 + (2 v_2 - v_1)/12
 * (THEORY.md). A body that is straight to the decimals of its file has mu_1/mu_2 up to 1e9, so that
 * v_1 is huge and the tumbling is lost.
 *
 * Equation:  N = N_rest + mu_1 t t^T, where t = N e_1/mu_1 is the screw (twist) that a torque about
 *            axis 1 causes, and N_rest e_1 = 0. The step has N' = N_rest + factor^2 mu_1 t t^T in
 *            place of N, that is N' = B N B^T with B = 1 - (1 - factor) t e_1^T, which turns with
 *            the body. In terms of particles K' = K B^-1, B^-1 = 1 + (1/factor - 1) t e_1^T.
 * Limits:    averages over configurations are those of any positive definite mobility. The fast
 *            spin averages what the rest of the body does over angles about axis 1, whatever its
 *            rate. Only the spin itself diffuses more slowly.
 */
struct SlowedSpin {
    typedef Eigen::Matrix<double, 6, 1> Vector6d;
    typedef Eigen::Matrix<double, 6, 6> Matrix6d;

    Eigen::Vector3d axis = Eigen::Vector3d::Zero();  // e_1, body frame
    Vector6d screw = Vector6d::Zero();               // t = (V, W), body frame, with W = e_1
    double factor = 1;                               // 1: the spin is not slowed

    bool isSlowed() const { return factor < 1; }
    bool operator==(const SlowedSpin& other) const {
        return axis == other.axis && screw == other.screw && factor == other.factor;
    }
    /** B, body frame. */
    Matrix6d congruence() const;
    /** B N B^T, body frame. */
    Matrix6d slow(const Matrix6d& mobility) const;
};

/**
 * The variance of the spin in a step, rad^2, below which no spin is slowed. The rate of tumbling
 * then has an error of 0.1 %, by v_1/12. FixmanMidpoint, whose mid-point turns spin into tumbling,
 * has one of 1.2 v_1 (measured; docs/THEORY.md).
 */
constexpr double resolvedSpin = 0.01;
/**
 * No spin is slowed below this multiple of the next rotation. With v_1 = 3 v_2 the error of
 * tumbling, (2 v_2 - v_1)/12, is that of a sphere with the other sign.
 */
constexpr double leastSpinRatio = 3;

/** The two largest rotational mobilities of a body, and how its spin is slowed in a step. */
struct BodyRotation {
    double fastest = 0, second = 0;  // mu_1, mu_2
    SlowedSpin spin;
    /** The fastest mobility of the step. */
    double fastestInStep() const { return spin.factor * spin.factor * fastest; }
    /** The longest step that has the real spin, ps. */
    double longestStep(double kT) const { return resolvedSpin / (2 * kT * fastest); }
};

/**
 * @param mobility      6 x 6 of the body alone, body frame
 * @param doubleEnergy  2 kT h, kJ ps/mol; 0: nothing is slowed
 */
BodyRotation findRotation(const Eigen::MatrixXd& mobility, double doubleEnergy);

}  // namespace RigidHIPlugin

#endif
