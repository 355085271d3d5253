#ifndef RIGIDHI_STRESSLET_BASIS_H_
#define RIGIDHI_STRESSLET_BASIS_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/** The matrix of v x. */
inline Eigen::Matrix3d crossProduct(const Eigen::Vector3d& v) {
    Eigen::Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

/** Columns r.B_a of an orthonormal basis B_a (a = 0..4) of the symmetric traceless tensors. */
inline Eigen::Matrix<double, 3, 5> contractBasis(const Eigen::Vector3d& r) {
    const double half = std::sqrt(0.5), third = std::sqrt(1.0 / 6);
    Eigen::Matrix<double, 3, 5> v;
    // B_0 = (2zz-xx-yy)/sqrt 6, B_1 = (xx-yy)/sqrt 2, then (xy+yx), (xz+zx), (yz+zy) over sqrt 2
    v << -third * r.x(), half * r.x(), half * r.y(), half * r.z(), 0,  //
        -third * r.y(), -half * r.y(), half * r.x(), 0, half * r.z(),  //
        2 * third * r.z(), 0, 0, half * r.x(), half * r.y();
    return v;
}

/** sum over a of s_a B_a */
inline Eigen::Matrix3d tensorOfStresslet(const Eigen::Matrix<double, 5, 1>& numbers) {
    Eigen::Matrix3d tensor;
    for (int k = 0; k < 3; k++) tensor.col(k) = contractBasis(Eigen::Vector3d::Unit(k)) * numbers;
    return tensor;
}

/** B_a : E. Only the symmetric traceless part of the tensor contributes. */
inline Eigen::Matrix<double, 5, 1> inStressletBasis(const Eigen::Matrix3d& E) {
    Eigen::Matrix<double, 5, 1> numbers = Eigen::Matrix<double, 5, 1>::Zero();
    for (int k = 0; k < 3; k++)
        numbers += contractBasis(Eigen::Vector3d::Unit(k)).transpose() * E.col(k);
    return numbers;
}

/**
 * For two spheres that do not overlap, the velocities and strain rates that their stresslets S
 * cause, in units of 1/(8 pi viscosity). n is the direction from j to i:
 *
 *     V_i = along n (n.S_j.n) + towards S_j.n,   Omega_i = -omega (S_j.n) x n,
 *     S_i:E_i = ssI S_i:S_j + ssV (S_i.n).(S_j.n) + ssS (n.S_i.n) (n.S_j.n)
 *
 * The stresslet's flow is 3 n (n.S.n)/r^2. Each Faxén Laplacian adds (12 S.n - 30 n (n.S.n))/r^4
 * times its coefficient.
 */
class StressletPair {
public:
    StressletPair(double ai, double aj, double r)
        : squares(ai * ai + aj * aj), r2(r * r), r3(r2 * r), r4(r2 * r2), r5(r4 * r) {}
    struct Velocity {
        double along, towards;
    };
    /**
     * The velocity of a sphere of radius a caused by the stresslet of a sphere of radius
     * `ofStresslet`.
     */
    Velocity velocity(double a, double ofStresslet) const {
        const double laplacian = a * a / 6 + ofStresslet * ofStresslet / 10;
        return {3 / r2 - 30 * laplacian / r4, 12 * laplacian / r4};
    }
    double omega() const { return -3 / r3; }
    double ssI() const { return 12 * (squares / 10) / r5; }
    double ssV() const { return 2 * (3 / r3 - 60 * (squares / 10) / r5); }
    double ssS() const { return -15 / r3 + 210 * (squares / 10) / r5; }

private:
    const double squares, r2, r3, r4, r5;
};

/** S:E of one sphere caused by its own stresslet. */
inline double ownStressletFunction(double a) { return 6 / (5 * (a * a * a)); }

}  // namespace RigidHIPlugin

#endif
