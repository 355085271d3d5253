// The free rotation of a rigid body.
//
// Equation:  dq/dt = q (0, w)/2, dl/dt = l x w, w_k = l_k / I_k (body frame).
// Order:     2 in t (symmetric splitting); exact for linear bodies.
// Reference: Miller et al., J. Chem. Phys. 116, 8649 (2002); Davidchack et al. 2015, eqs. 17 and
// 18. There the conjugate momentum is pi = 2 S(q)(0, l), and chi_l t is half the angle used here.

#if defined(RIGIDHI_FREE_ROTOR_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_FREE_ROTOR_INL_H_
#undef RIGIDHI_FREE_ROTOR_INL_H_
#else
#define RIGIDHI_FREE_ROTOR_INL_H_
#endif

#include "rigidbody/Quaternion-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

/** q turned about body axis 1, 2 or 3 by twice the half angle: q * (cos, sin e_axis). */
template <int axis, class Real>
inline Quaternion<Real> turnAboutAxis(const Quaternion<Real>& q, const Real& sine,
                                      const Real& cosine) {
    if (axis == 1)
        return {cosine * q.w - sine * q.x, cosine * q.x + sine * q.w, cosine * q.y + sine * q.z,
                cosine * q.z - sine * q.y};
    if (axis == 2)
        return {cosine * q.w - sine * q.y, cosine * q.x - sine * q.z, cosine * q.y + sine * q.w,
                cosine * q.z + sine * q.x};
    return {cosine * q.w - sine * q.z, cosine * q.x + sine * q.y, cosine * q.y - sine * q.x,
            cosine * q.z + sine * q.w};
}

/**
 * Psi_{t,axis} of eq. 17: the rotation about one body axis only. In the body frame l turns the
 * other way.
 */
template <int axis, class Real, class Time>
inline void rotateAboutAxis(Quaternion<Real>& q, Vector3<Real>& l,
                            const Vector3<Real>& inverseMoments, const Time& t) {
    const Real l_axis = axis == 1 ? l.x : axis == 2 ? l.y : l.z;
    const Real inverseMoment = axis == 1   ? inverseMoments.x
                               : axis == 2 ? inverseMoments.y
                                           : inverseMoments.z;
    Real sine, cosine;
    sincos(Real(0.5 * t) * l_axis * inverseMoment, sine, cosine);
    q = turnAboutAxis<axis>(q, sine, cosine);
    const Real sine2 = Real(2.0) * sine * cosine;  // of the whole angle
    const Real cosine2 = Real(1.0) - Real(2.0) * sine * sine;
    if (axis == 1)
        l = {l.x, cosine2 * l.y + sine2 * l.z, cosine2 * l.z - sine2 * l.y};
    else if (axis == 2)
        l = {cosine2 * l.x - sine2 * l.z, l.y, cosine2 * l.z + sine2 * l.x};
    else
        l = {cosine2 * l.x + sine2 * l.y, cosine2 * l.y - sine2 * l.x, l.z};
}

/**
 * Psi_t of eq. 18: axes 3-2-1-2-3. With I_1 <= I_2 <= I_3 the axis of the smallest moment is
 * innermost, where its fast spin does no harm.
 */
template <class Real, class Time>
inline void rotateFreely(Quaternion<Real>& q, Vector3<Real>& l, const Vector3<Real>& inverseMoments,
                         const Time& t) {
    rotateAboutAxis<3>(q, l, inverseMoments, 0.5 * t);
    rotateAboutAxis<2>(q, l, inverseMoments, 0.5 * t);
    rotateAboutAxis<1>(q, l, inverseMoments, t);
    rotateAboutAxis<2>(q, l, inverseMoments, 0.5 * t);
    rotateAboutAxis<3>(q, l, inverseMoments, 0.5 * t);
}

/**
 * The exact rotation of a linear body (I_1 = 0, l_1 = 0, I_2 = I_3): about l, which is constant.
 * The splitting above would let l_1, which has no friction, drift away from 0.
 */
template <class Real, class Time>
inline void rotateLinearBodyFreely(Quaternion<Real>& q, const Vector3<Real>& l,
                                   const Vector3<Real>& inverseMoments, const Time& t) {
    q = q * exponential(Real(0.5 * t) * multiply(l, inverseMoments));
}

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
