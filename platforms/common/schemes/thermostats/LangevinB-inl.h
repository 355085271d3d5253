// Langevin B.
//
// Equation:  as Langevin A (schemes/thermostats/LangevinA-inl.h).
// Method:    half a step of the exact Ornstein-Uhlenbeck process, a step of the Hamiltonian system,
//            half a step of the process again ("OBABO").
// Order:     weak 2; kinetic temperatures are the most accurate of the three.   Cost: one force
//            evaluation a step.
// Reference: Davidchack, Ouldridge, Tretyakov 2015, eq. 27.
// Limits:    any gamma, Gamma.

#if defined(RIGIDHI_LANGEVIN_B_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_LANGEVIN_B_INL_H_
#undef RIGIDHI_LANGEVIN_B_INL_H_
#else
#define RIGIDHI_LANGEVIN_B_INL_H_
#endif

#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

struct LangevinB {
    template <class Flow, class Time>
    static void beforeForces(Flow& flow, const Time& h) {
        flow.ornsteinUhlenbeck(0);  // P_1, Pi_1: over h/2, with xi and eta
        flow.kick(h / 2);           // P_2 = P_1 + h/2 f,  Pi_2 = Pi_1 + h/2 F
        flow.drift(h);              // R_{k+1} = R_k + h/m P_2,  (Q_{k+1}, Pi_3) = Psi_h(Q_k, Pi_2)
    }
    template <class Flow, class Time>
    static void afterForces(Flow& flow, const Time& h) {
        flow.kick(h / 2);  // Pi_4, P_3: with the forces at k+1
        flow.ornsteinUhlenbeck(
            1);  // P_{k+1}, Pi_{k+1}: over h/2, with new numbers zeta and varsigma
    }
    static Thermostat coefficients(const BodyInertia& body, const HeatBath& bath, double h) {
        return ornsteinUhlenbeckCoefficients(body, bath, h / 2);
    }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
