// Langevin with hydrodynamic interactions.
//
// Equation:  dR = p/m dt, dp = f dt - (xi V)_t dt + noise, dL = tau dt - (xi V)_r dt + noise, and
//            free rotation. xi(R, q) is the friction matrix of all bodies, and the noise has
//            covariance 2 kT xi (Davidchack 2017, eqs. 16 to 18).
// Method:    Langevin C with the coupled Ornstein-Uhlenbeck process in place of its own (eqs. 26
//            and 27), symmetrised: schemes/FluidOrnsteinUhlenbeck.h. For bodies with isotropic and
//            constant friction ornsteinUhlenbeck() does this part, exactly as in Langevin C.
// Order:     weak 2.   Cost: one force evaluation and one friction evaluation a step.
// Reference: Davidchack, Ouldridge, Tretyakov, J. Chem. Phys. 147, 224103 (2017), eq. 27; the free
// rotation is the symmetric one of Davidchack 2015, eq. 18.
// Limits:    any friction; no inertia about axes about which the fluid does not resist rotation.
// Noise:     it acts on momenta, and the friction depends on poses. The interpretations of Ito and
//            Stratonovich therefore coincide, and the equation has no drift term.

#if defined(RIGIDHI_LANGEVIN_HI_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_LANGEVIN_HI_INL_H_
#undef RIGIDHI_LANGEVIN_HI_INL_H_
#else
#define RIGIDHI_LANGEVIN_HI_INL_H_
#endif

#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

struct LangevinHI {
    template <class Flow, class Time>
    static void beforeFriction(Flow& flow, const Time& h) {
        flow.kick(h / 2);           // P_1 = P_k + h/2 f,  Pi_1 = Pi_k + h/2 F
        flow.drift(h / 2);          // R_1 = R_k + h/(2m) P_1,  (Q_1, Pi_2) = Psi_{h/2}(Q_k, Pi_1)
        flow.ornsteinUhlenbeck(0);  // P_2, Pi_3 of bodies that the fluid does not couple;
                                    // FluidMomenta relaxes the others at (R_1, Q_1)
    }
    template <class Flow, class Time>
    static void afterFriction(Flow& flow, const Time& h) {
        flow.drift(h / 2);  // R_{k+1} = R_1 + h/(2m) P_2,  (Q_{k+1}, Pi_4) = Psi_{h/2}(Q_1, Pi_3)
    }
    /** Both parts in one, where the fluid couples nothing. */
    template <class Flow, class Time>
    static void beforeForces(Flow& flow, const Time& h) {
        beforeFriction(flow, h);
        afterFriction(flow, h);
    }
    template <class Flow, class Time>
    static void afterForces(Flow& flow, const Time& h) {
        flow.kick(h / 2);  // P_{k+1} = P_2 + h/2 f_{k+1},  Pi_{k+1} = Pi_4 + h/2 F_{k+1}
    }
    /**
     * Factors of free particles that the fluid does not see. The fluid has the factors of all
     * others.
     */
    static Thermostat coefficients(const BodyInertia& body, const HeatBath& bath, double h) {
        return ornsteinUhlenbeckCoefficients(body, bath, h);
    }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
