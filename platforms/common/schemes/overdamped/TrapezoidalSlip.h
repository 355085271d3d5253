// Trapezoidal slip (T-S).
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34), N = (K^T M^-1
//            K)^-1, N^(1/2) = N K^T M^-1 M^(1/2).
// Method:    F_D = -(kT/delta) (K^T(Q+) - K^T(Q-)) lambda and s_D = (kT/delta) (M(Q+) - M(Q-))
//            lambda as in TractionEulerMaruyama.h;
//            s = sqrt(2 kT/h) M^(1/2) W at Q^n;
//            predictor  U^n = N (F + K^T M^-1 s),  Q* = Rotate(Q^n, h U^n);
//            corrector  U* = N* (F* + 2 F_D + K*^T M*^-1 (s + 2 s_D)),  Q^{n+1} = Rotate(Q^n, h
//                       (U^n + U*)/2):
//            Sprinkle, Balboa Usabiaga, Patankar, Donev, J. Chem. Phys. 147, 244103 (2017);
//            docs/theory/without_momenta.md.
// Order:     weak 1; 2 at T = 0.   Bias of the drift: O(delta^2).
// Cost:      two force evaluations (the second at t + h), three solves at two configurations, two
//            products with M, one square root a step. Iterations of the corrector's solve begin at
//            the predictor's forces.
// Reference: Sprinkle, Balboa Usabiaga, Patankar, Donev, J. Chem. Phys. 147, 244103 (2017).
// Limits:    as random finite differences. Where the divergence is known or 0, kT div N takes the
//            place of F_D and s_D: two solves, no products, no directions. For spheres K = 1, and s
//            is the same at Q*, so the average over both ends gives no drift either.

#ifndef RIGIDHI_TRAPEZOIDAL_SLIP_H_
#define RIGIDHI_TRAPEZOIDAL_SLIP_H_

#include <array>
#include <cmath>

#include "schemes/OverdampedScheme.h"

namespace RigidHIPlugin {

class TrapezoidalSlip : public OverdampedScheme {
public:
    static constexpr std::array<double, 2> forcesAt = {0, 1};
    void run(int stage, OverdampedMove& m) override { stage == 0 ? predict(m) : correct(m); }

private:
    void predict(OverdampedMove& m) {
        m.atStart();
        if (m.kT == 0) {
            slip.resize(0, 0);
            m.solve(m.velocity(0.5, m.force), U_start);
            m.keepForces();
        } else {
            m.drawForSlips(OverdampedMove::First);
            m.thermalSlip(slip);
            slip *= std::sqrt(2 * m.kT / m.h);
            m.recordThermalSlip(std::sqrt(2 * m.kT / m.h));
            if (m.driftIsKnown()) {
                m.solve(m.velocity(0.5, m.force, slip), U_start);
                m.keepForces();
                drift.setZero(m.getNumRows(), 1);
                m.addKnownDrift(m.kT, drift);
            } else {
                // One solve with two columns: F + s and the random wrench.
                m.drawDirections();
                m.solve(m.direction(0, m.directions), m.velocity(0.5, m.force, slip), U_both);
                m.keepForces(1);
                U_start = U_both.col(1);
                m.drawTractions(forceDifference, difference, true);
                m.recordTractions(m.kT);
                if (m.axesTurn()) m.drawAxisForces(axisForces);
                slip += 2 * m.kT * difference;
            }
        }
        m.goFromStart(m.h, U_start);
    }
    void correct(OverdampedMove& m) {
        m.atPresent();
        total = m.force;
        const bool hasDrift = m.kT > 0, isDifferenced = hasDrift && !m.driftIsKnown();
        if (isDifferenced) total += 2 * m.kT * forceDifference;
        if (isDifferenced && m.axesTurn()) {
            total += 2 * m.kT * axisForces;
            m.solveFromKept(m.velocity(0.5, total, slip).including(2 * m.kT, axisForces), U);
        } else {
            m.solveFromKept(m.velocity(0.5, total, slip), U);
        }
        if (hasDrift && !isDifferenced) U += 2 * drift;
        U = 0.5 * (U + U_start);
        m.goFromStart(m.h, U);
    }
    Vectors total, U, U_start, slip, difference, forceDifference, axisForces, drift;
    Vectors U_both;  // two columns
};

}  // namespace RigidHIPlugin

#endif
