// Vectors and quaternions over a number type: `double`, or a SIMD pack of bodies. Quaternions are
// (w, x, y, z). A body's q turns body-frame vectors into lab-frame ones: v_lab = q v_body q^-1.

#if defined(RIGIDHI_QUATERNION_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_QUATERNION_INL_H_
#undef RIGIDHI_QUATERNION_INL_H_
#else
#define RIGIDHI_QUATERNION_INL_H_
#endif

#include <cmath>

#include "rigidbody/Target.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

// Scalar versions of functions that every number type must have.
inline void sincos(double x, double& sine, double& cosine) {
    sine = std::sin(x);
    cosine = std::cos(x);
}
inline double squareRoot(double x) { return std::sqrt(x); }
inline double maximum(double a, double b) { return a > b ? a : b; }

template <class Real>
struct Vector3 {
    Real x, y, z;
    Vector3& operator+=(const Vector3& b) {
        x = x + b.x;
        y = y + b.y;
        z = z + b.z;
        return *this;
    }
};

template <class Real>
inline Vector3<Real> operator+(const Vector3<Real>& a, const Vector3<Real>& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class Real>
inline Vector3<Real> operator-(const Vector3<Real>& a, const Vector3<Real>& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class Real>
inline Vector3<Real> operator*(const Real& s, const Vector3<Real>& a) {
    return {s * a.x, s * a.y, s * a.z};
}
/** Component by component. */
template <class Real>
inline Vector3<Real> multiply(const Vector3<Real>& a, const Vector3<Real>& b) {
    return {a.x * b.x, a.y * b.y, a.z * b.z};
}
template <class Real>
inline Real dot(const Vector3<Real>& a, const Vector3<Real>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class Real>
inline Vector3<Real> cross(const Vector3<Real>& a, const Vector3<Real>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <class Real>
struct Quaternion {
    Real w, x, y, z;
};

/** The Hamilton product: (a b) turns by b first, then by a. */
template <class Real>
inline Quaternion<Real> operator*(const Quaternion<Real>& a, const Quaternion<Real>& b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
            a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}
template <class Real>
inline Quaternion<Real> conjugate(const Quaternion<Real>& q) {
    return {q.w, Real(0.0) - q.x, Real(0.0) - q.y, Real(0.0) - q.z};
}

/** exp of the pure quaternion (0, v): (cos |v|, sin |v| v/|v|); a turn by the angle 2|v| about v.
 */
template <class Real>
inline Quaternion<Real> exponential(const Vector3<Real>& v) {
    // Below this length v is negligible compared with 1, so dividing by `tiny` instead of |v| only
    // avoids 0/0.
    const double tiny = 1e-150;
    const Real length = squareRoot(dot(v, v));
    Real sine, cosine;
    sincos(length, sine, cosine);
    const Real sinc = sine / maximum(length, Real(tiny));
    return {cosine, sinc * v.x, sinc * v.y, sinc * v.z};
}

/**
 * Restore |q| = 1. Every step multiplies q by unit quaternions, so that |q| - 1 is a random walk of
 * rounding errors. One Newton step for 1/sqrt keeps it at rounding level for any number of steps,
 * and changes nothing else.
 */
template <class Real>
inline void renormalise(Quaternion<Real>& q) {
    const Real scale = Real(1.5) - Real(0.5) * (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    q = {scale * q.w, scale * q.x, scale * q.y, scale * q.z};
}

/** The rotation matrix A with v_lab = A v_body, as rows. */
template <class Real>
struct Rotation {
    Vector3<Real> row[3];
    explicit Rotation(const Quaternion<Real>& q) {
        const Real two(2.0), one(1.0);
        row[0] = {one - two * (q.y * q.y + q.z * q.z), two * (q.x * q.y - q.w * q.z),
                  two * (q.x * q.z + q.w * q.y)};
        row[1] = {two * (q.x * q.y + q.w * q.z), one - two * (q.x * q.x + q.z * q.z),
                  two * (q.y * q.z - q.w * q.x)};
        row[2] = {two * (q.x * q.z - q.w * q.y), two * (q.y * q.z + q.w * q.x),
                  one - two * (q.x * q.x + q.y * q.y)};
    }
    Vector3<Real> toLab(const Vector3<Real>& v_body) const {
        return {dot(row[0], v_body), dot(row[1], v_body), dot(row[2], v_body)};
    }
    Vector3<Real> toBody(const Vector3<Real>& v_lab) const {
        return v_lab.x * row[0] + v_lab.y * row[1] + v_lab.z * row[2];
    }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
