// The part that a no-slip plane adds to the Rotne-Prager-Yamakawa mobility of two spheres above it
// (or of one sphere with itself), for a pair (Real = double) or a SIMD pack of pairs.
//
// Equation:  8 pi eta M = (1 + a_i^2/6 lap_i) (1 + a_j^2/6 lap_j) G for forces and velocities, with
//            Blake's image G of a point force. For a torque or an angular velocity, half of a curl
//            replaces an operator. Let z_i, z_j be heights above the wall, R the vector from the
//            mirror image of j to i (R_z = z_i + z_j), p = 1/|R|, ' a mirrored vector, e = e_z, H
//            the matrix of second derivatives of p, d_z the derivative by R_z. Then
//               G f = - p f + grad p (R.f') + 2 z_i f_z grad p - 2 z_j e (f'.grad p)
//                     + 2 z_i z_j H f'.
//            As p is harmonic, the operators only add (a_i^2 + a_j^2)/3 H f' and replace z by
//            z + (a^2/3) d_z: the series ends. Curls of the gradients vanish:
//               8 pi eta W_i = - grad p x F + 2 e x (z_j + (a_j^2/3) d_z) H F'
//                              (V_i from T_j: the transpose of the swap)
//               8 pi eta W_i = - H_zz T - (H T)'/2 - e x H (e x T).
// Reference: Blake, Proc. Camb. Phil. Soc. 70, 303 (1971); Swan, Brady, Phys. Fluids 19, 113306
//            (2007), there for equal radii.
// Limits:    z_i >= a_i, z_j >= a_j. The spheres may overlap each other, because the average of the
//            image over a sphere is then the same. Together with the free mobility, the whole
//            matrix is symmetric positive definite. The mobility has no lubrication with the wall:
//            at contact a sphere moves towards the wall with a quarter of the free mobility, where
//            the true mobility is 0.

#if defined(RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_INL_H_
#undef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_INL_H_
#else
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_INL_H_
#endif

#include "mobility/models/rotneprager/RotnePragerYamakawa-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

/**
 * The factors of
 *     tt: I F' + RR R (R.F') + Re R F'_z + eR e (R.F') + ee e F'_z
 *     rt: cube R x F' + e x (R (rtRR (R.F') + rtRe F'_z) + rtI F')
 *     tr: cube R x T - trI t - (R.t) (trRR R + tre e),  t = e x T
 *     rr: rrI T - fifth (R.T) (R/2 - R_z e) - fifth (R.t) e x R
 */
template <class Real>
struct WallMobility {
    Vector3<Real> R;
    Real I, RR, Re, eR, ee, rtRR, rtRe, rtI, trI, trRR, tre, rrI, cube, fifth;
    Real rtRolling, trRolling, rte;  // for addWallBlocks()
};

/**
 * The factors for a pair of spheres.
 *
 * @param r  r_i - r_j; (0, 0, 0) for a sphere itself
 * @param z_i  height of i's centre above the wall
 */
template <class Real>
inline WallMobility<Real> wallMobility(const Vector3<Real>& r, const Real& z_i, const Real& z_j,
                                       const Real& a_i, const Real& a_j) {
    WallMobility<Real> m;
    const Real Z = z_i + z_j;
    m.R = {r.x, r.y, Z};
    const Real p2 = Real(1.0) / addedDot(m.R, m.R), p = squareRoot(p2);
    const Real p3 = p * p2, p5 = p3 * p2, Zp2 = Z * p2, Z2p2 = Z * Zp2;
    const Real square_i = a_i * a_i, square_j = a_j * a_j,
               third = Real(1.0 / 3.0) * (square_i + square_j);

    // H, d_z H and d_z^2 H enter with these factors.
    const Real first = multiplyAdd(Real(2.0) * z_i, z_j, third);
    const Real second =
        Real(2.0 / 3.0) * (z_i * square_j + z_j * square_i);  // the same for the pair swapped
    const Real fourth = Real(2.0 / 9.0) * (square_i * square_j);
    const Real secondZ = second * Zp2, fourthP = fourth * p2;
    m.I = p3 * (Real(3.0) * secondZ - first + fourthP * (Real(3.0) - Real(15.0) * Z2p2)) - p;
    m.RR = p5 * (Real(3.0) * first - Real(15.0) * secondZ +
                 fourthP * (Real(105.0) * Z2p2 - Real(15.0))) -
           p3;
    const Real both = p5 * (Real(3.0) * second - Real(30.0) * fourth * Zp2);
    // 2 (z + (a^2/3) d_z) grad p has this factor of -R.
    const Real gradient_i = Real(2.0) * p3 * negativeMultiplyAdd(square_i, Zp2, z_i);
    const Real gradient_j = Real(2.0) * p3 * negativeMultiplyAdd(square_j, Zp2, z_j);
    m.Re = both + gradient_i;
    m.eR = both + gradient_j;
    m.ee = Real(2.0) * (p + p3 * (third + Real(3.0) * fourthP));

    m.cube = p3;
    m.tre = Real(2.0) * square_i * p5;
    m.rte = Real(2.0) * square_j * p5;
    m.rtRe = Real(2.0) * p3 + m.rte;
    m.rtRR = p5 * (Real(6.0) * z_j - Real(10.0) * square_j * Zp2);
    m.trRR = p5 * (Real(6.0) * z_i - Real(10.0) * square_i * Zp2);
    m.rtI = Real(0.0) - gradient_j;
    m.trI = Real(2.0) * Z * p3 - gradient_i;
    m.rtRolling = Z * p3 - gradient_j;
    m.trRolling = Z * p3 - gradient_i;
    m.fifth = Real(3.0) * p5;
    m.rrI = p3 * (Real(0.5) - Real(3.0) * Z2p2);
    return m;
}

/**
 * As addPairVelocities(): add the velocities of sphere i that the wall induces under forces and
 * torques on sphere j, times 8 pi eta.
 */
template <int columns, bool targetTorque, bool sourceTorque, class Real>
inline void addWallVelocities(const WallMobility<Real>& m, const Vector3<Real>* force,
                              const Vector3<Real>* torque, Vector3<Real>* velocity,
                              Vector3<Real>* omega) {
    const Vector3<Real>& R = m.R;
    for (int c = 0; c < columns; c++) {
        const Vector3<Real> F = {force[c].x, force[c].y, Real(0.0) - force[c].z};  // mirrored
        const Real RF = addedDot(R, F);
        addMultiple(m.I, F, velocity[c]);
        addMultiple(multiplyAdd(m.RR, RF, m.Re * F.z), R, velocity[c]);
        velocity[c].z = multiplyAdd(m.eR, RF, multiplyAdd(m.ee, F.z, velocity[c].z));
        if (targetTorque) {
            addCross(m.cube * R, F, omega[c]);
            const Real along = multiplyAdd(m.rtRR, RF, m.rtRe * F.z);
            omega[c].x = omega[c].x - multiplyAdd(along, R.y, m.rtI * F.y);
            omega[c].y = omega[c].y + multiplyAdd(along, R.x, m.rtI * F.x);
        }
        if (sourceTorque) {
            const Vector3<Real>& T = torque[c];
            const Real Rt = R.y * T.x - R.x * T.y;  // t = (-T_y, T_x, 0)
            addCross(m.cube * R, T, velocity[c]);
            addMultiple(Real(0.0) - m.trRR * Rt, R, velocity[c]);
            velocity[c].x = multiplyAdd(m.trI, T.y, velocity[c].x);
            velocity[c].y = negativeMultiplyAdd(m.trI, T.x, velocity[c].y);
            velocity[c].z = negativeMultiplyAdd(m.tre, Rt, velocity[c].z);
            if (targetTorque) {
                const Real RT = m.fifth * addedDot(R, T), around = m.fifth * Rt;
                addMultiple(m.rrI, T, omega[c]);
                addMultiple(Real(-0.5) * RT, R, omega[c]);
                omega[c].x = multiplyAdd(around, R.y, omega[c].x);
                omega[c].y = negativeMultiplyAdd(around, R.x, omega[c].y);
                omega[c].z = multiplyAdd(RT, R.z, omega[c].z);
            }
        }
    }
}

/** The blocks of the matrix for a pair: velocities (t) and angular velocities (r) of i from forces
 * and torques on j. */
template <class Real>
struct PairBlocks {
    Real tt[3][3], rt[3][3], tr[3][3], rr[3][3];
};

/**
 * Fill the blocks of the free mobility, times `scale`. Blocks of torques or rotations that
 * particles lack stay untouched.
 */
template <bool targetTorque, bool sourceTorque, class Real>
inline void fillPairBlocks(const PairMobility<Real>& m, const Vector3<Real>& r, const Real& scale,
                           PairBlocks<Real>& blocks) {
    const Real zero(0.0), v[3] = {r.x, r.y, r.z};
    // The same products form entries at mirrored positions in the matrix.
    const auto symmetric = [&](const Real& identity, const Real& outer, Real(&block)[3][3]) {
        for (int a = 0; a < 3; a++) {
            block[a][a] = scale * (identity + outer * (v[a] * v[a]));
            for (int b = 0; b < a; b++) block[a][b] = block[b][a] = scale * (outer * (v[a] * v[b]));
        }
    };
    const auto crossing = [&](const Real& factor, Real(&block)[3][3]) {
        const Real x = scale * (factor * r.x), y = scale * (factor * r.y),
                   z = scale * (factor * r.z);
        const Real rows[3][3] = {{zero, z, zero - y}, {zero - z, zero, x}, {y, zero - x, zero}};
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) block[a][b] = rows[a][b];
    };
    symmetric(m.ttI, m.ttR, blocks.tt);
    if (targetTorque) crossing(m.rt, blocks.rt);
    if (sourceTorque) crossing(m.tr, blocks.tr);
    if (targetTorque && sourceTorque) symmetric(m.rrI, m.rrR, blocks.rr);
}

/**
 * Add the wall's contribution to the blocks, times `scale`: addWallVelocities() for unit forces and
 * torques. The same operations form entries at mirrored positions in the matrix (those of the
 * swapped pair, where x and y change signs), so these entries agree to the last bit.
 */
template <bool targetTorque, bool sourceTorque, class Real>
inline void addWallBlocks(const WallMobility<Real>& m, const Real& scale,
                          PairBlocks<Real>& blocks) {
    const Real &x = m.R.x, &y = m.R.y, &Z = m.R.z;
    const Real xx = x * x, yy = y * y, xy = x * y;
    const auto add = [&](Real& entry, const Real& value) { entry = entry + scale * value; };
    const auto subtract = [&](Real& entry, const Real& value) { entry = entry - scale * value; };
    add(blocks.tt[0][0], multiplyAdd(m.RR, xx, m.I));
    add(blocks.tt[1][1], multiplyAdd(m.RR, yy, m.I));
    add(blocks.tt[0][1], m.RR * xy);
    add(blocks.tt[1][0], m.RR * xy);
    const Real up = multiplyAdd(m.RR, Z, m.eR), across = multiplyAdd(m.RR, Z, m.Re);
    add(blocks.tt[2][0], up * x);
    add(blocks.tt[2][1], up * y);
    subtract(blocks.tt[0][2], across * x);
    subtract(blocks.tt[1][2], across * y);
    subtract(blocks.tt[2][2], multiplyAdd(multiplyAdd(m.RR, Z, m.Re + m.eR), Z, m.I + m.ee));
    if (targetTorque) {
        const Real tilting = multiplyAdd(m.rtRR, Z, m.rte + m.cube);
        subtract(blocks.rt[0][0], m.rtRR * xy);
        add(blocks.rt[1][1], m.rtRR * xy);
        add(blocks.rt[1][0], multiplyAdd(m.rtRR, xx, m.rtRolling));
        subtract(blocks.rt[0][1], multiplyAdd(m.rtRR, yy, m.rtRolling));
        subtract(blocks.rt[2][0], m.cube * y);
        add(blocks.rt[2][1], m.cube * x);
        add(blocks.rt[0][2], tilting * y);
        subtract(blocks.rt[1][2], tilting * x);
    }
    if (sourceTorque) {
        const Real tilting = multiplyAdd(m.trRR, Z, m.tre + m.cube);
        subtract(blocks.tr[0][0], m.trRR * xy);
        add(blocks.tr[1][1], m.trRR * xy);
        add(blocks.tr[0][1], multiplyAdd(m.trRR, xx, m.trRolling));
        subtract(blocks.tr[1][0], multiplyAdd(m.trRR, yy, m.trRolling));
        add(blocks.tr[0][2], m.cube * y);
        subtract(blocks.tr[1][2], m.cube * x);
        subtract(blocks.tr[2][0], tilting * y);
        add(blocks.tr[2][1], tilting * x);
    }
    if (targetTorque && sourceTorque) {
        const Real half = Real(0.5) * m.fifth, tilting = half * Z;
        add(blocks.rr[0][0], multiplyAdd(m.fifth, yy, negativeMultiplyAdd(half, xx, m.rrI)));
        add(blocks.rr[1][1], multiplyAdd(m.fifth, xx, negativeMultiplyAdd(half, yy, m.rrI)));
        subtract(blocks.rr[0][1], Real(1.5) * m.fifth * xy);
        subtract(blocks.rr[1][0], Real(1.5) * m.fifth * xy);
        add(blocks.rr[2][0], tilting * x);
        add(blocks.rr[2][1], tilting * y);
        subtract(blocks.rr[0][2], tilting * x);
        subtract(blocks.rr[1][2], tilting * y);
        add(blocks.rr[2][2], multiplyAdd(tilting, Z, m.rrI));
    }
}

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
