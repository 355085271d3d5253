// Random finite differences (RFD).
//
// Equation:  dQ/dt = N F + sqrt(2 kT) N^(1/2) dW/dt + kT div N (Delong 2015, eq. 34).
// Method:    U = N F + sqrt(2 kT/h) N^(1/2) W + (kT/delta) (N(Q~) - N) W~,
//            Q~ = Rotate(Q^n, delta W~);  Q^{n+1} = Rotate(Q^n, h U): Delong 2015, eqs. 48 and 51.
//            Translations are displaced by delta times the body's length L, and as a wrench their
//            part of W~ is divided by L.
// Order:     weak 1; 1 at T = 0.   Bias of the drift: O(delta^2); its odd powers vanish on average.
// Cost:      one force evaluation, two mobility problems (one matrix-free solve has two columns),
//            one square root a step.
// Reference: Delong, Balboa Usabiaga, Donev, J. Chem. Phys. 143, 144107 (2015), eqs. 48 and 51.
// Limits:    a known divergence (one body in a uniform fluid; 0 for spheres in an unbounded fluid)
//            takes the place of the difference: one mobility problem, no directions W~. If the
//            divergence is 0, this scheme is EulerMaruyama.

#ifndef RIGIDHI_RANDOM_FINITE_DIFFERENCE_H_
#define RIGIDHI_RANDOM_FINITE_DIFFERENCE_H_

#include "schemes/overdamped/EulerMaruyama.h"

namespace RigidHIPlugin {

class RandomFiniteDifference : public EulerMaruyama {
public:
    void run(int, OverdampedMove& m) override {
        if (!findVelocity(m)) {
            m.drawDirections();
            double delta = m.differenceStep();
            m.displace(delta, displaced);
            m.solve(m.velocity(1, total, thermalSlips), m.direction(-m.kT / delta, m.directions),
                    U_both);
            m.at(displaced);
            m.solve(m.direction(m.kT / delta, m.directions), difference);
            difference -= U_both.col(1);
            U = U_both.col(0) + (m.kT / delta) * difference;
        }
        m.goFromStart(m.h, U);
    }

private:
    Vectors U_both;  // two columns
    Vectors difference;
    std::vector<Pose> displaced;
};

}  // namespace RigidHIPlugin

#endif
