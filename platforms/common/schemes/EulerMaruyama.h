// Euler-Maruyama.
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34), without its last term, the stochastic drift.
// Method:    U = N F + sqrt(2 kT/h) N^(1/2) W;  Q^{n+1} = Rotate(Q^n, h U): Delong 2015, eq. 37.
// Order:     weak 1 where div N = 0 (constant N; spheres in an unbounded fluid); elsewhere none: it samples exp(-U/kT)/N instead of
//            exp(-U/kT). 1 at T = 0.
// Cost:      one force evaluation, one mobility problem and one square root a step.

#ifndef RIGIDHI_EULER_MARUYAMA_H_
#define RIGIDHI_EULER_MARUYAMA_H_

#include "schemes/OverdampedMove.h"

namespace RigidHIPlugin {

struct EulerMaruyama {
    static constexpr const char* drift = "";
    static constexpr Differenced differenced = Differenced::Nothing;
    static constexpr bool forcesAtStart = true, forcesInBetween = false;
    /** total = F + sqrt(2 kT/h) N^(-1/2) W: N total is the velocity without drift. */
    static void sumUpWrenches(OverdampedMove& m) {
        m.total = m.force;
        if (m.kT == 0) return;
        m.thermalWrench(OverdampedMove::First, m.noise);
        m.total += std::sqrt(2 * m.kT / m.h) * m.noise;
    }
    /**
     * U = N total + kT div N at the start, where the drift is known without differences.
     * @return whether it is: if not, `total` is ready, and nothing else is done
     */
    static bool findVelocity(OverdampedMove& m) {
        m.atStart();
        sumUpWrenches(m);
        if (m.kT > 0 && !m.driftIsKnown()) return false;
        m.solve(m.total, m.U);
        if (m.kT > 0) m.addKnownDrift(m.kT, m.U);
        return true;
    }
    static void predict(OverdampedMove& m) {
        m.atStart();
        sumUpWrenches(m);
        m.solve(m.total, m.U);
        m.goFromStart(m.h, m.U);
    }
    static void correct(OverdampedMove&) {}
};

}  // namespace RigidHIPlugin

#endif
