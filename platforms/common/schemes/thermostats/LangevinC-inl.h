// Langevin C.
//
// Equation:  as Langevin A (schemes/thermostats/LangevinA-inl.h).
// Method:    half a step of the Hamiltonian system, a step of the exact Ornstein-Uhlenbeck process,
//            half a step of the Hamiltonian system again ("BAOAB").
// Order:     weak 2; configurational averages are the most accurate of the three.   Cost: one force
//            evaluation a step.
// Reference: Davidchack, Ouldridge, Tretyakov 2015, eq. 28.
// Limits:    any gamma, Gamma.

#if defined(RIGIDHI_LANGEVIN_C_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_LANGEVIN_C_INL_H_
#undef RIGIDHI_LANGEVIN_C_INL_H_
#else
#define RIGIDHI_LANGEVIN_C_INL_H_
#endif

#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

struct LangevinC {
    template <class Flow, class Time>
    static void beforeForces(Flow& flow, const Time& h) {
        flow.kick(h / 2);           // P_1 = P_k + h/2 f,  Pi_1 = Pi_k + h/2 F
        flow.drift(h / 2);          // R_1 = R_k + h/(2m) P_1,  (Q_1, Pi_2) = Psi_{h/2}(Q_k, Pi_1)
        flow.ornsteinUhlenbeck(0);  // P_2, Pi_3: over h
        flow.drift(h / 2);  // R_{k+1} = R_1 + h/(2m) P_2,  (Q_{k+1}, Pi_4) = Psi_{h/2}(Q_1, Pi_3)
    }
    template <class Flow, class Time>
    static void afterForces(Flow& flow, const Time& h) {
        flow.kick(h / 2);  // P_{k+1} = P_2 + h/2 f_{k+1},  Pi_{k+1} = Pi_4 + h/2 F_{k+1}
    }
    static Thermostat coefficients(const BodyInertia& body, const HeatBath& bath, double h) {
        return ornsteinUhlenbeckCoefficients(body, bath, h);
    }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
