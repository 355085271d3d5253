// Trapezoidal slip (T-S).
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34), N = (K^T M^-1 K)^-1, N^(1/2) = N K^T M^-1 M^(1/2).
// Method:    F_D = -(kT/delta) (K^T(Q+) - K^T(Q-)) lambda and s_D = (kT/delta) (M(Q+) - M(Q-)) lambda as in TractionEulerMaruyama.h;
//            s = sqrt(2 kT/h) M^(1/2) W at Q^n;
//            predictor  U^n = N (F + K^T M^-1 s),  Q* = Rotate(Q^n, h U^n);
//            corrector  U* = N* (F* + 2 F_D + K*^T M*^-1 (s + 2 s_D)),  Q^{n+1} = Rotate(Q^n, h (U^n + U*)/2):
//            Sprinkle, Balboa Usabiaga, Patankar, Donev, J. Chem. Phys. 147, 244103 (2017); docs/THEORY.md.
// Order:     weak 1; 2 at T = 0.   Bias of the drift: O(delta^2).
// Cost:      two force evaluations (the second at t + h), three solves at two configurations, two products with M, one square root a step.
// Limits:    as random finite differences. Where the divergence is known or 0, kT div N takes the place of F_D and s_D: two solves, no
//            products, no directions. Of spheres K = 1, and s is no other at Q*: the average over both ends makes no drift either.

#ifndef RIGIDHI_TRAPEZOIDAL_SLIP_H_
#define RIGIDHI_TRAPEZOIDAL_SLIP_H_

#include "schemes/OverdampedMove.h"

namespace RigidHIPlugin {

struct TrapezoidalSlip {
    static constexpr const char* drift =
        "by random finite differences along which blob forces are kept, and the mobility at the end of the step";
    static constexpr Differenced differenced = Differenced::Products;
    static constexpr bool forcesAtStart = true, forcesInBetween = true;
    static double timeOfForces(double h) { return h; }
    static void predict(OverdampedMove& m) {
        m.atStart();
        if (m.kT == 0) {
            m.solve(m.force, m.U_start);
        } else {
            m.drawForSlips(OverdampedMove::First);
            m.thermalSlip(m.slip);
            m.slip *= std::sqrt(2 * m.kT / m.h);
            if (m.driftIsKnown()) {
                m.solve(m.force, m.slip, m.U_start);
                m.drift.setZero(m.getNumRows(), 1);
                m.addKnownDrift(m.kT, m.drift);
            } else {
                // The solves for F + s and for the random wrench in one.
                m.drawDirections();
                m.both.resize(m.getNumRows(), 2);
                m.both << m.directions, m.force;
                m.slips_both.setZero(m.slip.rows(), 2);
                m.slips_both.col(1) = m.slip;
                m.solve(m.both, m.slips_both, m.U_both);
                m.U_start = m.U_both.col(1);
                m.drawTractions(m.forceDifference, m.difference);
                m.slip += 2 * m.kT * m.difference;
            }
        }
        m.goFromStart(m.h, m.U_start);
    }
    static void correct(OverdampedMove& m) {
        m.atPresent();
        if (m.kT == 0) {
            m.solve(m.force, m.U);
        } else if (m.driftIsKnown()) {
            m.solve(m.force, m.slip, m.U);
            m.U += 2 * m.drift;
        } else {
            m.total = m.force + 2 * m.kT * m.forceDifference;
            m.solve(m.total, m.slip, m.U);
        }
        m.U = (0.5 * (m.U + m.U_start)).eval();
        m.goFromStart(m.h, m.U);
    }
};

}  // namespace RigidHIPlugin

#endif
