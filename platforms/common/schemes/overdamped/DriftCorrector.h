// The generalised drifter-corrector (gDC), with finite differences (DriftCorrectorFD) or random
// ones (DriftCorrectorRFD).
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N, N = (K^T M^-1 K)^-1,
//            N^(1/2) = N K^T M^-1 M^(1/2) (Westwood 2022, eqs. 26, 36).
// Method:    Westwood 2022, eqs. 37 to 44, with v = sqrt(2 kT/h) M^(1/2) W of the same W
//            throughout:
//              V~ = (K^T K)^-1 K^T v at Q^n,   nu = 1 + (h/2) div V~,   Q^m = Rotate(Q^n, h V~/2),
//              U = N (F + nu K^T M^-1 v) at Q^m,   Q^{n+1} = Rotate(Q^n, h U).
//            setDriftCorrectorScaling(Whole) is the paper's
//              U = N (F + K^T M^-1 v),   Q^{n+1} = Rotate(Q^n, nu h U).
//            Both forms have the same drift, that of <(nu - 1) v>; the part nu F has none, because
//            <nu> = 1.
//            FD:  div V~ = sum_i (V~_i(Q^n + delta e_i) - V~_i) / delta, one-sided (eq. 39; error
//                 O(delta)).
//            RFD: div V~ = W~.(V~(Q^n + delta W~) - V~) / delta (eq. 40). Translations are
//            displaced by delta times the body's length.
//            Random fields (fluids on grids): V~ at every pose comes from the same field, whose
//            divergence needs no square roots and no solves.
//            In a box that a shear tilts, Q^m also follows the flow; otherwise bodies would be
//            displaced relative to the distant images of others.
// Order:     weak 1; 1 at T = 0 (the mid-point follows the noise only).
// Cost:      one force evaluation (at t + h/2), one solve. Square roots of M: two, and in addition
//            one for each row of the twists (FD) or one (RFD).
// Zero drift: spheres in an unbounded fluid (K = 1, div N = 0) keep v of Q^n at Q^m, and nu = 1: U
// = N F + v, with one square root. Noise taken at the mid-point alone would cause the drift kT (d_j
// A_ik) A_jk, A = M^(1/2), and nu alone the drift kT A_ik d_j A_jk. These two cancel, but neither
// is 0.
// Known drift: a body alone in a uniform fluid has div V~ = 0 and nu = 1. Its v turns with the
// body, and this gives the drift.
// Reference: Westwood, Delmotte, Keaveny, J. Comput. Phys. 467, 111437 (2022), eqs. 37 to 44.
// Limits:    as random finite differences. Square roots must be smooth functions of poses: a
//            Cholesky factor, or Lanczos iterations to a tolerance that fits delta.

#ifndef RIGIDHI_DRIFT_CORRECTOR_H_
#define RIGIDHI_DRIFT_CORRECTOR_H_

#include <array>
#include <cmath>
#include <vector>

#include "schemes/OverdampedScheme.h"

namespace RigidHIPlugin {

template <bool randomDifferences>
class DriftCorrector : public OverdampedScheme {
public:
    static constexpr std::array<double, 2> forcesAt = {noForces, 0.5};
    void run(int stage, OverdampedMove& m) override { stage == 0 ? predict(m) : correct(m); }

private:
    void predict(OverdampedMove& m) {
        scale = 1;  // nu
        if (m.kT == 0) {
            U.setZero(m.getNumRows(), 1);
        } else {
            m.drawForSlips(OverdampedMove::First);
            m.atStart();
            velocities(m, U);
            // In two cases the drift is known, and nu stays 1. For one body in a uniform fluid, V~
            // turns with the body and div V~ = 0. Spheres without drift keep v in correct().
            if (!m.driftIsKnown()) {
                scale += 0.5 * m.h * divergence(m);
                m.driftFactors.add(scale);
            }
        }
        m.addPrescribed(U);
        m.addShear(U);
        m.goFromStart(m.h / 2, U);
    }
    void correct(OverdampedMove& m) {
        m.atPresent();
        if (m.kT == 0) {
            slip.resize(0, 0);
        } else {
            if (!m.driftIsZero()) {
                m.thermalSlip(slip);
                slip *= std::sqrt(2 * m.kT / m.h);
            }
            if (!m.driftFactorScalesAll()) slip *= scale;
        }
        m.solve(m.velocity(1, m.force, slip), U);
        if (m.kT > 0)
            m.recordThermalSlip((m.driftFactorScalesAll() ? 1 : scale) * std::sqrt(2 * m.kT / m.h));
        const double nu = m.driftFactorScalesAll() ? scale : 1;
        if (m.driftFactorScalesAll()) m.recordFactor(nu);
        m.removeTurnsFromHolds();
        m.goFromStart(m.h, U, nu);
    }

    /** V~ at the poses where m is. */
    void velocities(OverdampedMove& m, Vectors& twists) {
        m.thermalSlip(slip);
        slip *= std::sqrt(2 * m.kT / m.h);
        m.nearestTwists(slip, twists);
    }
    double divergence(OverdampedMove& m) {
        if (m.knowsDivergence()) return std::sqrt(2 * m.kT / m.h) * m.divergenceOfField();
        double delta = m.differenceStep();
        if (randomDifferences) {
            m.drawDirections();
            m.displace(delta, displaced);
            m.at(displaced);
            velocities(m, difference);
            difference -= U;
            return m.directions.col(0).dot(difference.col(0)) / delta;
        }
        double sum = 0;
        for (int i = 0; i < m.getNumRows(); i++) {
            if (!m.isFree(i)) continue;
            double step = delta;
            m.displaceAlong(i, step, displaced);
            m.at(displaced);
            velocities(m, difference);
            sum += (difference(i, 0) - U(i, 0)) / (step * m.lengthOfRow(i));
        }
        return sum;
    }
    Vectors U, slip, difference;
    std::vector<Pose> displaced;
    double scale = 1;  // nu
};

using DriftCorrectorFD = DriftCorrector<false>;
using DriftCorrectorRFD = DriftCorrector<true>;

}  // namespace RigidHIPlugin

#endif
