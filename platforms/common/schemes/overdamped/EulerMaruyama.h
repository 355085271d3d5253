// Euler-Maruyama.
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34), without its
//            last term, the stochastic drift.
// Method:    U = N F + sqrt(2 kT/h) N^(1/2) W;  Q^{n+1} = Rotate(Q^n, h U): Delong 2015, eq. 37.
// Order:     weak 1 where div N = 0 (constant N; spheres in an unbounded fluid). Elsewhere the
//            scheme has no weak order: it samples exp(-U/kT)/N instead of exp(-U/kT). 1 at T = 0.
// Cost:      one force evaluation, one mobility problem and one square root a step. If the model
//            has a random field, it takes the place of the square root.
// Reference: Delong, Balboa Usabiaga, Donev, J. Chem. Phys. 143, 144107 (2015), eq. 37.
// Limits:    right averages only where div N = 0.

#ifndef RIGIDHI_EULER_MARUYAMA_H_
#define RIGIDHI_EULER_MARUYAMA_H_

#include <array>
#include <cmath>

#include "schemes/OverdampedScheme.h"

namespace RigidHIPlugin {

class EulerMaruyama : public OverdampedScheme {
public:
    static constexpr std::array<double, 1> forcesAt = {0};
    void run(int, OverdampedMove& m) override {
        m.atStart();
        sumUpWrenches(m);
        m.solve(m.velocity(1, total, thermalSlips), U);
        m.goFromStart(m.h, U);
    }

protected:
    /**
     * total = F + sqrt(2 kT/h) N^(-1/2) W, so that N total is the velocity without drift. If the
     * model has a random field, its slips v (random surface velocities) are the noise and need no
     * square root: total = F, thermalSlips = sqrt(2 kT/h) v.
     */
    void sumUpWrenches(OverdampedMove& m) {
        total = m.force;
        thermalSlips.resize(0, 0);
        if (m.kT == 0) return;
        if (m.slipsWillBeOfField()) {
            m.drawForSlips(OverdampedMove::First);
            m.thermalSlip(thermalSlips);
            thermalSlips *= std::sqrt(2 * m.kT / m.h);
            m.recordThermalSlip(std::sqrt(2 * m.kT / m.h));
        } else {
            m.thermalWrench(OverdampedMove::First, noise);
            total += std::sqrt(2 * m.kT / m.h) * noise;
        }
    }
    /**
     * U = N total + kT div N at the start, where the drift is known without differences.
     * @return whether the drift is known; if not, only `total` and `thermalSlips` are computed
     */
    bool findVelocity(OverdampedMove& m) {
        m.atStart();
        sumUpWrenches(m);
        if (m.kT > 0 && !m.driftIsKnown()) return false;
        m.solve(m.velocity(1, total, thermalSlips), U);
        if (m.kT > 0) m.addKnownDrift(m.kT, U);
        return true;
    }
    Vectors total, thermalSlips, noise, U;
};

}  // namespace RigidHIPlugin

#endif
