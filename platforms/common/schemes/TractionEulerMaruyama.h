// Traction Euler-Maruyama (EM-T).
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34), N = (K^T M^-1 K)^-1.
// Method:    the difference of N in the random finite difference, expressed through those of K and M, which need no solves. A solve with
//            a random wrench W~ gives blob forces lambda and twists U_R: K^T lambda = W~, M lambda = K U_R. With Q+- =
//            Rotate(Q^n, +-delta W~/2),
//              F_D = -(kT/delta) (K^T(Q+) - K^T(Q-)) lambda,   s_D = (kT/delta) [(M(Q+) - M(Q-)) lambda - (K(Q+) - K(Q-)) U_R],
//              U = N (F + F_D + K^T M^-1 s_D) + sqrt(2 kT/h) N^(1/2) W,   Q^{n+1} = Rotate(Q^n, h U):
//            Sprinkle, Balboa Usabiaga, Patankar, Donev, J. Chem. Phys. 147, 244103 (2017); docs/THEORY.md.
// Order:     weak 1; 1 at T = 0.   Bias of the drift: O(delta^2).
// Cost:      one force evaluation, two solves at one configuration, two products with M, one square root a step.
// Limits:    as random finite differences: where the divergence is known or 0, one solve, no products, no directions.

#ifndef RIGIDHI_TRACTION_EULER_MARUYAMA_H_
#define RIGIDHI_TRACTION_EULER_MARUYAMA_H_

#include "schemes/EulerMaruyama.h"

namespace RigidHIPlugin {

struct TractionEulerMaruyama {
    static constexpr const char* drift = "by random finite differences along which blob forces are kept";
    static constexpr Differenced differenced = Differenced::Products;
    static constexpr bool forcesAtStart = true, forcesInBetween = false;
    static void predict(OverdampedMove& m) {
        if (!EulerMaruyama::findVelocity(m)) {
            m.drawDirections();
            m.solve(m.directions, m.U_random);
            m.drawTractions(m.forceDifference, m.slip);
            m.rigidSlipDifference(m.U_random, m.difference);
            m.slip -= m.difference;
            m.total += m.kT * m.forceDifference;
            m.slip *= m.kT;
            m.solve(m.total, m.slip, m.U);
        }
        m.goFromStart(m.h, m.U);
    }
    static void correct(OverdampedMove&) {}
};

}  // namespace RigidHIPlugin

#endif
