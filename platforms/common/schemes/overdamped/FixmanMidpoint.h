// Fixman's midpoint scheme.
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N o N^(-1/2) dW/dt. The factor before o is taken at the
//            mid-point and the factor after it at the start of the step; this gives the stochastic
//            drift kT div N (Delong 2015, eq. 38).
// Method:    Delong 2015, eqs. 41 and 44, with (N^(-1/2))^n = N^-1 N^(1/2) (not its transpose:
//            docs/theory/corrections.md):
//            predictor  U = N F + sqrt(4 kT/h) N^(1/2) W_1,  Q^{n+1/2} = Rotate(Q^n, h U/2);
//            corrector  U = N F + sqrt(kT/h) N (N^(-1/2))^n (W_1 + W_2) at Q^{n+1/2},  Q^{n+1} =
//                       Rotate(Q^n, h U).
// Order:     weak 1 (2 for linear equations with constant noise); 2 at T = 0.
// Cost:      two force evaluations (the second at t + h/2), two mobility problems, two square roots
//            a step. Where div N = 0 the cost is the same: the scheme has no terms for the drift
//            that it could leave out, and its order needs the mid-point and both square roots.
// Reference: Delong, Balboa Usabiaga, Donev, J. Chem. Phys. 143, 144107 (2015), eqs. 41 and 44.
// Limits:    two square roots a step, also if the model has a random field. The scheme needs
//            (N^(-1/2))^n W itself, and K^T M^-1 times the field's slips takes as many iterations
//            as the square root.

#ifndef RIGIDHI_FIXMAN_MIDPOINT_H_
#define RIGIDHI_FIXMAN_MIDPOINT_H_

#include <array>
#include <cmath>

#include "schemes/OverdampedScheme.h"

namespace RigidHIPlugin {

class FixmanMidpoint : public OverdampedScheme {
public:
    static constexpr std::array<double, 2> forcesAt = {0, 0.5};
    static constexpr bool hasMobilityOfMidpoint = true;
    void run(int stage, OverdampedMove& m) override { stage == 0 ? predict(m) : correct(m); }

private:
    void predict(OverdampedMove& m) {
        m.atStart();
        total = m.force;
        if (m.kT > 0) {
            m.thermalWrench(OverdampedMove::First, noise);
            total += std::sqrt(4 * m.kT / m.h) * noise;
            m.thermalWrench(OverdampedMove::Second, noise2);
            noise += noise2;
            if (m.axesTurn()) {
                m.drawDirections();
                m.solve(m.direction(0, m.directions), U);
                m.drawAxisForces(axisForces);
            }
        }
        m.solve(m.velocity(0, total), U);
        m.goFromStart(m.h / 2, U);
    }
    void correct(OverdampedMove& m) {
        m.atPresent();
        total = m.force;
        if (m.kT > 0) total += std::sqrt(m.kT / m.h) * noise;
        if (m.kT > 0 && m.axesTurn()) {
            total += m.kT * axisForces;
            m.solve(m.velocity(1, total).including(m.kT, axisForces), U);
        } else {
            m.solve(m.velocity(1, total), U);
        }
        m.goFromStart(m.h, U);
    }
    Vectors total, noise, noise2, axisForces, U;
};

}  // namespace RigidHIPlugin

#endif
