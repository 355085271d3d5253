// The Rotne-Prager-Yamakawa mobility of two spheres, in unbounded fluid or above a no-slip wall,
// for sums that visit each pair once. The same few factors give the velocities of i from j, and of
// j from i.
//
// Equation:  That of mobility/models/rotneprager/RotnePragerYamakawa-inl.h and
//            mobility/models/wall/RotnePragerYamakawaWall-inl.h. Above a wall the free part and the
//            image are added block by block. With (x, y, z) = r_i - r_j and s = x F_x + y F_y,
//            symmetry reduces the blocks to
//     tt:  V_xy = P F_xy + (x, y) (Q s + U F_z)                         V_z = W s + C F_z
//     tr:  V_xy = a t + (x, y) c R + b T_z (y, -x)                      V_z = d R
//     rt:  W_xy = (-a F_y, a F_x) + (y, -x) (c s + d F_z)               W_z = b (y F_x - x F_y)
//     rr:  W_xy = I T_xy + (x, y) (N S + G T_z) + (y, -x) around R      W_z = H S + E T_z
//            with t = (T_y, -T_x), R = y T_x - x T_y, S = x T_x + y T_y. The swapped pair has the
//            transpose: U and W, G and H, and the a, b, c, d of tr and rt are exchanged.
// Cost:      Multiplications for each column and direction: 10 for blobs, free or above a wall; for
//            spheres 32 and 43.
// Limits:    Those of the two files. Overlapping spheres take the free factors from PairMobility.

#if defined(RIGIDHI_PAIRS_BOTH_WAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_PAIRS_BOTH_WAYS_INL_H_
#undef RIGIDHI_PAIRS_BOTH_WAYS_INL_H_
#else
#define RIGIDHI_PAIRS_BOTH_WAYS_INL_H_
#endif

#include "hwy/base.h"
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

/** Forces and torques on a sphere, or its velocity and angular velocity, for several columns. */
template <class Real, int columns>
struct LinearAndAngular {
    Vector3<Real> linear[columns], angular[columns];
};

/**
 * The mobility of spheres that do not overlap.
 *
 * @param inverse  1/|r|, or 0: then everything is 0
 * @param third  (a_i^2 + a_j^2)/3
 */
template <class Real>
HWY_INLINE PairMobility<Real> farPairMobilityOf(const Real& inverse, const Real& third) {
    const Real inverse2 = inverse * inverse, inverse3 = inverse * inverse2,
               share = inverse3 * third;
    PairMobility<Real> m;
    m.ttI = inverse + share;
    m.ttR = negativeMultiplyAdd(Real(3.0) * inverse2, share, inverse3);
    m.tr = m.rt = inverse3;
    m.rrI = Real(-0.5) * inverse3;
    m.rrR = Real(1.5) * inverse3 * inverse2;
    return m;
}

/** A pair in unbounded fluid; r = r_i - r_j. */
template <class Real>
struct FreeFactors {
    Vector3<Real> r, rt, tr;
    Real ttI, ttR, rrI, rrR;

    HWY_INLINE FreeFactors(const Vector3<Real>& r, const PairMobility<Real>& m)
        : r{r.x, r.y, r.z}, rt{m.rt * r.x, m.rt * r.y, m.rt * r.z}, tr{m.tr * r.x, m.tr * r.y,
                                                                       m.tr * r.z},
          ttI(m.ttI), ttR(m.ttR), rrI(m.rrI), rrR(m.rrR) {}
    /**
     * Add the velocities of i induced by forces and torques on j, times 8 pi eta. Without torque_i
     * sphere i has no W, and without torque_j sphere j has no T.
     */
    template <int columns, bool torque_i, bool torque_j>
    HWY_INLINE void addToFirst(const LinearAndAngular<Real, columns>& load_j,
                               LinearAndAngular<Real, columns>& v_i) const {
        for (int c = 0; c < columns; c++) {
            const Vector3<Real>&F = load_j.linear[c], &T = load_j.angular[c];
            if (torque_j) addCross(T, tr, v_i.linear[c]);
            if (torque_i) addCross(F, rt, v_i.angular[c]);
            addSymmetric<torque_i && torque_j>(F, T, v_i.linear[c], v_i.angular[c]);
        }
    }
    /**
     * Add the velocities of j induced by forces and torques on i: the same with -r, and with tr and
     * rt swapped.
     */
    template <int columns, bool torque_i, bool torque_j>
    HWY_INLINE void addToSecond(const LinearAndAngular<Real, columns>& load_i,
                                LinearAndAngular<Real, columns>& v_j) const {
        for (int c = 0; c < columns; c++) {
            const Vector3<Real>&F = load_i.linear[c], &T = load_i.angular[c];
            if (torque_i) addCross(rt, T, v_j.linear[c]);
            if (torque_j) addCross(tr, F, v_j.angular[c]);
            addSymmetric<torque_i && torque_j>(F, T, v_j.linear[c], v_j.angular[c]);
        }
    }

private:
    template <bool torques>
    HWY_INLINE void addSymmetric(const Vector3<Real>& F, const Vector3<Real>& T, Vector3<Real>& V,
                                 Vector3<Real>& W) const {
        addMultiple(ttI, F, V);
        addMultiple(ttR * addedDot(r, F), r, V);
        if (torques) {
            addMultiple(rrI, T, W);
            addMultiple(rrR * addedDot(r, T), r, W);
        }
    }
};

/** A pair above a wall, free part and image. The letters are those of the equation above. */
template <class Real>
struct WallFactors {
    struct Coupling {
        Real a, b, c, d;
    };
    Real x, y;
    Real P, Q, U, W, C;
    Coupling ij, ji;  // tr of i from j, and of j from i
    Real I, N, G, H, E, around;

    /**
     * @param r, free   r_i - r_j, and the free part of spheres that do not overlap (0 if they do)
     * @param p         the inverse distance of i from the mirror image of j; 0 makes the image part
     *     0
     * @param z_i, z_j  heights above the wall
     * @param b_i, b_j  a third of the squares of radii
     */
    HWY_INLINE WallFactors(const Vector3<Real>& r, const PairMobility<Real>& free, const Real& p,
                           const Real& z_i, const Real& z_j, const Real& b_i, const Real& b_j)
        : x(r.x), y(r.y) {
        const Real three(3.0), six(6.0), ten(10.0), thirty(30.0);
        const Real Z = z_i + z_j, third = b_i + b_j;
        const Real p2 = p * p, p3 = p * p2, p5 = p3 * p2, Zp2 = Z * p2, w = Z * Zp2;
        // These are halves of the factors of H, d_z H and d_z^2 H in RotnePragerYamakawaWall-inl.h,
        // except for the first, which is the whole factor.
        const Real first = multiplyAdd(z_i + z_i, z_j, third),
                   second = multiplyAdd(z_i, b_j, z_j * b_i);
        const Real fourth = b_i * b_j, secondZ = second * Zp2, fourthP = fourth * p2;
        const Real identity =
            multiplySubtract(p3,
                             multiplyAdd(fourthP, negativeMultiplyAdd(thirty, w, six),
                                         multiplySubtract(six, secondZ, first)),
                             p);
        const Real outer =
            multiplySubtract(p5,
                             multiplyAdd(fourthP, multiplySubtract(Real(210.0), w, thirty),
                                         three * negativeMultiplyAdd(ten, secondZ, first)),
                             p3);
        const Real twice = p3 + p3, p56 = six * p5;
        const Real both = p56 * negativeMultiplyAdd(ten * fourth, Zp2, second);
        const Real gradient_i = twice * negativeMultiplyAdd(three * b_i, Zp2, z_i);
        const Real gradient_j = twice * negativeMultiplyAdd(three * b_j, Zp2, z_j);
        const Real vertical = multiplyAdd(twice, multiplyAdd(six, fourthP, third), p + p);

        const Real outerZ = outer * Z, freeZ = free.ttR * r.z, Re = both + gradient_i,
                   eR = both + gradient_j;
        P = free.ttI + identity;
        Q = free.ttR + outer;
        U = freeZ - (outerZ + Re);
        W = freeZ + (outerZ + eR);
        C = multiplyAdd(freeZ, r.z, free.ttI - identity) -
            multiplyAdd(Z, outerZ + (Re + eR), vertical);

        const Real rolling = Z * p3, f = free.tr, fz = f * r.z, drop = f - p3,
                   steep = ten * three * Zp2;
        ij.a = fz + (rolling - gradient_i);
        ji.a = (rolling - gradient_j) - fz;
        ij.b = p3 - f;
        ji.b = drop;
        ij.c = p5 * multiplySubtract(steep, b_i, six * z_i);
        ji.c = p5 * multiplySubtract(steep, b_j, six * z_j);
        ij.d = multiplyAdd(ij.c, Z, negativeMultiplyAdd(p56, b_i, drop));
        ji.d = multiplySubtract(p56, b_j, multiplyAdd(ji.c, Z, drop));

        const Real half = Real(1.5) * p5, halfZ = half * Z, rz = free.rrR * r.z;
        around = half + half;
        I = multiplyAdd(p3, negativeMultiplyAdd(three, w, Real(0.5)), free.rrI);
        N = free.rrR - half;
        G = rz - halfZ;
        H = rz + halfZ;
        E = multiplyAdd(rz, r.z, multiplyAdd(halfZ, Z, I));
    }
    /** As those of FreeFactors. */
    template <int columns, bool torque_i, bool torque_j>
    HWY_INLINE void addToFirst(const LinearAndAngular<Real, columns>& load_j,
                               LinearAndAngular<Real, columns>& v_i) const {
        for (int c = 0; c < columns; c++)
            add<torque_i, torque_j>(U, W, ij, ji, G, H, load_j.linear[c], load_j.angular[c],
                                    v_i.linear[c], v_i.angular[c]);
    }
    template <int columns, bool torque_i, bool torque_j>
    HWY_INLINE void addToSecond(const LinearAndAngular<Real, columns>& load_i,
                                LinearAndAngular<Real, columns>& v_j) const {
        for (int c = 0; c < columns; c++)
            add<torque_j, torque_i>(W, U, ji, ij, H, G, load_i.linear[c], load_i.angular[c],
                                    v_j.linear[c], v_j.angular[c]);
    }

private:
    template <bool targetTorque, bool sourceTorque>
    HWY_INLINE void add(const Real& U, const Real& W, const Coupling& tr, const Coupling& rt,
                        const Real& G, const Real& H, const Vector3<Real>& F,
                        const Vector3<Real>& T, Vector3<Real>& V, Vector3<Real>& omega) const {
        const Real s = multiplyAdd(x, F.x, y * F.y), along = multiplyAdd(Q, s, U * F.z);
        V.x = multiplyAdd(x, along, multiplyAdd(P, F.x, V.x));
        V.y = multiplyAdd(y, along, multiplyAdd(P, F.y, V.y));
        V.z = multiplyAdd(W, s, multiplyAdd(C, F.z, V.z));
        if (targetTorque) {
            const Real tilt = multiplyAdd(rt.c, s, rt.d * F.z);
            omega.x = multiplyAdd(y, tilt, negativeMultiplyAdd(rt.a, F.y, omega.x));
            omega.y = negativeMultiplyAdd(x, tilt, multiplyAdd(rt.a, F.x, omega.y));
            omega.z = multiplyAdd(rt.b, negativeMultiplyAdd(x, F.y, y * F.x), omega.z);
        }
        if (sourceTorque) {
            const Real R = negativeMultiplyAdd(x, T.y, y * T.x), cR = tr.c * R, spin = tr.b * T.z;
            V.x = multiplyAdd(y, spin, multiplyAdd(x, cR, multiplyAdd(tr.a, T.y, V.x)));
            V.y = negativeMultiplyAdd(x, spin,
                                      multiplyAdd(y, cR, negativeMultiplyAdd(tr.a, T.x, V.y)));
            V.z = multiplyAdd(tr.d, R, V.z);
            if (targetTorque) {
                const Real S = multiplyAdd(x, T.x, y * T.y), inner = multiplyAdd(N, S, G * T.z),
                           turn = around * R;
                omega.x = multiplyAdd(y, turn, multiplyAdd(x, inner, multiplyAdd(I, T.x, omega.x)));
                omega.y = negativeMultiplyAdd(x, turn,
                                              multiplyAdd(y, inner, multiplyAdd(I, T.y, omega.y)));
                omega.z = multiplyAdd(H, S, multiplyAdd(E, T.z, omega.z));
            }
        }
    }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
