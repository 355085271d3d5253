// Rotne-Prager-Yamakawa mobility of two spheres of any radii in unbounded fluid, for a pair (Real =
// double) or a SIMD pack of pairs. A force F_j and a torque T_j on sphere j move sphere i with V_i,
// W_i; r = r_i - r_j:
//
//     8 pi eta V_i = ttI F_j + ttR r (r.F_j) + tr T_j x r
//     8 pi eta W_i = rt F_j x r + rrI T_j + rrR r (r.T_j)
//
// Method:    Surface averages of the Stokeslet over both spheres, which may be far apart,
//            overlapping, or one inside the other. The whole matrix is positive definite for all
//            positions, continuous, and symmetric (tr of a pair is rt of the swapped pair). Its
//            divergence with respect to positions is 0, like that of the Stokeslet:
//            docs/theory/details_of_steps.md.
// Reference: Rotne, Prager, J. Chem. Phys. 50, 4831 (1969); Yamakawa, ibid. 53, 436 (1970);
//            overlapping and unequal: Zuk et al., J. Fluid Mech. 741, R5 (2014).
// Limits:    The mobility is pairwise and has no lubrication near contact. Spheres of one radius at
//            one place cannot move apart: the matrix is then singular.

#if defined(RIGIDHI_ROTNE_PRAGER_YAMAKAWA_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_INL_H_
#undef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_INL_H_
#else
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_INL_H_
#endif

#include "rigidbody/Quaternion-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

// The scalar versions of these functions (the others are in Quaternion-inl.h).
/** a b + c; packs round once where the machine can do so. */
inline double multiplyAdd(double a, double b, double c) { return a * b + c; }
/** c - a b, likewise. */
inline double negativeMultiplyAdd(double a, double b, double c) { return c - a * b; }
/** a b - c, likewise. */
inline double multiplySubtract(double a, double b, double c) { return a * b - c; }
/** Lane by lane: a > b ? x : y. */
inline double selectGreater(double a, double b, double x, double y) { return a > b ? x : y; }
/** Whether a > b in every lane. */
inline bool allGreater(double a, double b) { return a > b; }

/** The factors above, in nm^-1 (ttI), nm^-3 (ttR, tr, rt, rrI) and nm^-5 (rrR). */
template <class Real>
struct PairMobility {
    Real ttI, ttR, tr, rt, rrI, rrR;
};

/**
 * The mobility of spheres that do not overlap.
 *
 * @param distance2  |r|^2, not 0
 * @param squares  a_i^2 + a_j^2
 */
template <class Real>
inline PairMobility<Real> farPairMobility(const Real& distance2, const Real& squares) {
    const Real inverse = Real(1.0) / squareRoot(distance2);
    const Real inverse2 = inverse * inverse, inverse3 = inverse * inverse2;
    const Real u = squares * inverse2;
    PairMobility<Real> m;
    m.ttI = inverse * multiplyAdd(Real(1.0 / 3.0), u, Real(1.0));
    m.ttR = inverse3 * (Real(1.0) - u);
    m.tr = m.rt = inverse3;
    m.rrI = Real(-0.5) * inverse3;
    m.rrR = Real(1.5) * inverse3 * inverse2;
    return m;
}

/**
 * The mobility of spheres that overlap, or of which one is inside the other. r = 0 and a_i = a_j
 * gives the own mobility of a sphere.
 *
 * The published polynomials over R^3 are rewritten in x = ((a_i - a_j)/R)^2 <= 1, which avoids
 * quotients of small numbers. Once one sphere is inside the other, the functions keep their values
 * at R = |a_i - a_j|, and rt grows like r from the large sphere's centre. So the same formula holds
 * with R fixed at that value.
 */
template <class Real>
inline PairMobility<Real> overlappingPairMobility(const Real& distance2, const Real& a_i,
                                                  const Real& a_j) {
    // Below this distance r is negligible compared with any radius. Its square and the inverse of
    // the square are still finite.
    const double tiny = 1e-150;
    const Real s = a_i - a_j, sum = a_i + a_j, product = a_i * a_j;
    const Real R = maximum(maximum(squareRoot(distance2), maximum(s, Real(0.0) - s)), Real(tiny));
    const Real inverse = Real(1.0) / R;
    const Real z = s * inverse, x = z * z, inside = (Real(1.0) - x) * (Real(1.0) - x);
    const Real squares = a_i * a_i + a_j * a_j, q = squares + Real(4.0) * product;
    const Real cubes = a_i * a_i * a_i + a_j * a_j * a_j;
    const Real over = Real(1.0) / product, over3 = over * over * over;
    PairMobility<Real> m;
    m.ttI = Real(4.0 / 3.0) * over *
            (Real(0.5) * sum - Real(1.0 / 32.0) * R * (Real(3.0) + x) * (Real(3.0) + x));
    m.ttR = Real(1.0 / 8.0) * over * inside * inverse;
    const Real brackets =
        Real(5.0) * R * R - Real(27.0) * squares - Real(9.0) * x * sum * sum - x * x * q;
    m.rrI = Real(1.0 / 64.0) * over3 * (Real(32.0) * cubes + R * brackets);
    m.rrR = Real(3.0 / 64.0) * over3 * inside * inverse * (q - R * R);
    const Real up = Real(1.0) + z, down = Real(1.0) - z;
    m.rt = Real(1.0 / 16.0) * over * up * up / (a_i * a_i) *
           ((a_j + Real(3.0) * a_i) * (Real(2.0) - z) - Real(3.0) * R);
    m.tr = Real(1.0 / 16.0) * over * down * down / (a_j * a_j) *
           ((a_i + Real(3.0) * a_j) * (Real(2.0) + z) - Real(3.0) * R);
    return m;
}

/** The mobility of any pair. Packs compute overlaps only if some lane has one. */
template <class Real>
inline PairMobility<Real> pairMobility(const Real& distance2, const Real& a_i, const Real& a_j) {
    const Real sum = a_i + a_j, contact2 = sum * sum;
    PairMobility<Real> m = farPairMobility(distance2, a_i * a_i + a_j * a_j);
    if (allGreater(distance2, contact2)) return m;
    const PairMobility<Real> near = overlappingPairMobility(distance2, a_i, a_j);
    m.ttI = selectGreater(distance2, contact2, m.ttI, near.ttI);
    m.ttR = selectGreater(distance2, contact2, m.ttR, near.ttR);
    m.tr = selectGreater(distance2, contact2, m.tr, near.tr);
    m.rt = selectGreater(distance2, contact2, m.rt, near.rt);
    m.rrI = selectGreater(distance2, contact2, m.rrI, near.rrI);
    m.rrR = selectGreater(distance2, contact2, m.rrR, near.rrR);
    return m;
}

/** v <- v + a b */
template <class Real>
inline void addMultiple(const Real& a, const Vector3<Real>& b, Vector3<Real>& v) {
    v = {multiplyAdd(a, b.x, v.x), multiplyAdd(a, b.y, v.y), multiplyAdd(a, b.z, v.z)};
}
/** v <- v + a x b */
template <class Real>
inline void addCross(const Vector3<Real>& a, const Vector3<Real>& b, Vector3<Real>& v) {
    v.x = negativeMultiplyAdd(a.z, b.y, multiplyAdd(a.y, b.z, v.x));
    v.y = negativeMultiplyAdd(a.x, b.z, multiplyAdd(a.z, b.x, v.y));
    v.z = negativeMultiplyAdd(a.y, b.x, multiplyAdd(a.x, b.y, v.z));
}
template <class Real>
inline Real addedDot(const Vector3<Real>& a, const Vector3<Real>& b) {
    return multiplyAdd(a.x, b.x, multiplyAdd(a.y, b.y, a.z * b.z));
}

/**
 * Add the velocities of sphere i induced by forces and torques on sphere j, times 8 pi eta, for
 * several columns at once. Without targetTorque sphere i has no W, and without sourceTorque sphere
 * j has no T; the function then leaves these arrays alone.
 */
template <int columns, bool targetTorque, bool sourceTorque, class Real>
inline void addPairVelocities(const PairMobility<Real>& m, const Vector3<Real>& r,
                              const Vector3<Real>* force, const Vector3<Real>* torque,
                              Vector3<Real>* velocity, Vector3<Real>* omega) {
    const Vector3<Real> rt = m.rt * r, tr = m.tr * r;
    for (int c = 0; c < columns; c++) {
        addMultiple(m.ttI, force[c], velocity[c]);
        addMultiple(m.ttR * addedDot(r, force[c]), r, velocity[c]);
        if (sourceTorque) addCross(torque[c], tr, velocity[c]);
        if (targetTorque) addCross(force[c], rt, omega[c]);
        if (sourceTorque && targetTorque) {
            addMultiple(m.rrI, torque[c], omega[c]);
            addMultiple(m.rrR * addedDot(r, torque[c]), r, omega[c]);
        }
    }
}

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
