// Traction Euler-Maruyama (EM-T).
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34), N = (K^T M^-1
//            K)^-1.
// Method:    differences of K and M, which need no solves, express the difference of N in the
//            random finite difference. A solve with a random wrench W~ gives blob forces lambda and
//            twists U_R:
//              K^T lambda = W~, M lambda = K U_R.
//            With Q+- = Rotate(Q^n, +-delta W~/2),
//              F_D = -(kT/delta) (K^T(Q+) - K^T(Q-)) lambda,
//              s_D = (kT/delta) [(M(Q+) - M(Q-)) lambda - (K(Q+) - K(Q-)) U_R],
//              U = N (F + F_D + K^T M^-1 s_D) + sqrt(2 kT/h) N^(1/2) W,   Q^{n+1} = Rotate(Q^n, h
//              U):
//            Sprinkle, Balboa Usabiaga, Patankar, Donev, J. Chem. Phys. 147, 244103 (2017);
//            docs/theory/without_momenta.md.
// Order:     weak 1; 1 at T = 0.   Bias of the drift: O(delta^2).
// Cost:      one force evaluation, two solves at one configuration, two products with M, one square
//            root a step.
// Reference: Sprinkle, Balboa Usabiaga, Patankar, Donev, J. Chem. Phys. 147, 244103 (2017).
// Limits:    as random finite differences. Where the divergence is known or 0: one solve, no
//            products, no directions.

#ifndef RIGIDHI_TRACTION_EULER_MARUYAMA_H_
#define RIGIDHI_TRACTION_EULER_MARUYAMA_H_

#include "schemes/overdamped/EulerMaruyama.h"

namespace RigidHIPlugin {

class TractionEulerMaruyama : public EulerMaruyama {
public:
    void run(int, OverdampedMove& m) override {
        if (!findVelocity(m)) {
            m.drawDirections();
            m.solve(m.direction(0, m.directions), U_random);
            m.drawTractions(forceDifference, slip);
            m.rigidSlipDifference(U_random, difference);
            slip -= difference;
            total += m.kT * forceDifference;
            slip *= m.kT;
            if (m.axesTurn()) {
                m.drawAxisForces(axisForces);
                total += m.kT * axisForces;
                m.prescribeAxisDifference(m.kT, U_random);
                m.solve(m.velocity(1, total, thermalSlips, slip).including(m.kT, axisForces), U);
            } else {
                m.solve(m.velocity(1, total, thermalSlips, slip), U);
            }
            m.recordTractions(m.kT);
        }
        m.goFromStart(m.h, U);
    }

private:
    Vectors U_random, forceDifference, axisForces, slip, difference;
};

}  // namespace RigidHIPlugin

#endif
