// Random finite differences (RFD).
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34).
// Method:    U = N F + sqrt(2 kT/h) N^(1/2) W + (kT/delta) (N(Q~) - N) W~,  Q~ = Rotate(Q^n, delta W~);  Q^{n+1} = Rotate(Q^n, h U): Delong
//            2015, eqs. 48 and 51. Translations are displaced by delta times the body's length, and their part of W~ as a wrench
//            divided by it.
// Order:     weak 1; 1 at T = 0.   Bias of the drift: O(delta^2), its odd powers vanish on average.
// Cost:      one force evaluation, two mobility problems (one matrix-free solve has two columns), one square root a step.
// Limits:    where the divergence is known (one body in a uniform fluid) or 0 (spheres in an unbounded fluid), it is taken instead of the
//            difference: one mobility problem, no directions W~. If it is 0 this is EulerMaruyama.

#ifndef RIGIDHI_RANDOM_FINITE_DIFFERENCE_H_
#define RIGIDHI_RANDOM_FINITE_DIFFERENCE_H_

#include "schemes/EulerMaruyama.h"

namespace RigidHIPlugin {

struct RandomFiniteDifference {
    static constexpr const char* drift = "by a random finite difference of the mobility";
    static constexpr Differenced differenced = Differenced::Solves;
    static constexpr bool forcesAtStart = true, forcesInBetween = false;
    static void predict(OverdampedMove& m) {
        if (!EulerMaruyama::findVelocity(m)) {
            m.drawDirections();
            m.both.resize(m.getNumRows(), 2);
            m.both << m.total, m.directions;
            m.solve(m.both, m.U_both);
            double delta = m.differenceStep();
            m.displace(delta, m.displaced);
            m.at(m.displaced);
            m.solve(m.directions, m.difference);
            m.difference -= m.U_both.col(1);
            m.U = m.U_both.col(0) + (m.kT / delta) * m.difference;
        }
        m.goFromStart(m.h, m.U);
    }
    static void correct(OverdampedMove&) {}
};

}  // namespace RigidHIPlugin

#endif
