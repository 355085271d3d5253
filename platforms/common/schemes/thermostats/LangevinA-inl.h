// Langevin A.
//
// Equation:  dR = P/m dt,  dP = f dt - gamma P dt + sqrt(2 m gamma kT) dw;
//            dl_k = (l x w)_k dt + tau_k dt - Gamma_k l_k dt + sqrt(2 Gamma_k I_k kT) dW_k,
//            Gamma_k = Gamma M/(4 I_k), M = 4 / sum_k 1/I'_k over the axes with a non-zero moment
//            (body frame; the paper's pi is 2 S(q)(0, l)). I'_k is the moment I_k except for rods
//            (Thermostat.h), so that an elongated body tumbles at the right temperature.
// Method:    (Hamiltonian + noise) between two half steps of exact damping. The same random numbers
//            serve both kicks.
// Order:     weak 2.   Cost: one force evaluation a step.
// Reference: Davidchack, Ouldridge, Tretyakov 2015, eq. 20.
// Limits:    breaks down above gamma ~ 100/ps, Gamma ~ 200/ps in water, because the noise sits in
//            the kicks.

#if defined(RIGIDHI_LANGEVIN_A_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_LANGEVIN_A_INL_H_
#undef RIGIDHI_LANGEVIN_A_INL_H_
#else
#define RIGIDHI_LANGEVIN_A_INL_H_
#endif

#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

struct LangevinA {
    template <class Flow, class Time>
    static void beforeForces(Flow& flow, const Time& h) {
        flow.damp();       // P_1 = exp(-gamma h/2) P,  Pi_1 = exp(-Gamma J h/2) Pi
        flow.kick(h / 2);  // P_2 = P_1 + h/2 f + sqrt(h)/2 sqrt(2 m gamma kT) xi,
        flow.addNoise(0);  // Pi_2 likewise with F and sqrt(2 M Gamma kT) sum_l S_l Q eta_l
        flow.drift(h);     // R_{k+1} = R_k + h/m P_2,  (Q_{k+1}, Pi_3) = Psi_h(Q_k, Pi_2)
    }
    template <class Flow, class Time>
    static void afterForces(Flow& flow, const Time& h) {
        flow.kick(h / 2);  // Pi_4, P_3: with the forces at k+1 and the same xi, eta
        flow.addNoise(0);
        flow.damp();  // P_{k+1}, Pi_{k+1}
    }
    static Thermostat coefficients(const BodyInertia& body, const HeatBath& bath, double h) {
        Thermostat c;
        c.decay_p = std::exp(-bath.gamma * h / 2);
        c.noise_p = 0.5 * std::sqrt(h) * std::sqrt(2 * body.mass * bath.gamma * bath.kT);
        for (int k = 0; k < 3; k++) {
            if (!body.isLive(k)) continue;
            c.decay_l[k] = std::exp(-body.rotationalRate(k, bath.Gamma) * h / 2);
            c.noise_l[k] = 0.25 * std::sqrt(h) * std::sqrt(2 * body.M() * bath.Gamma * bath.kT);
            if (body.isElongated())  // 2 Gamma_k I_k kT in place of M Gamma kT/2
                c.noise_l[k] = std::sqrt(0.5 * h * body.rotationalRate(k, bath.Gamma) *
                                         body.moments[k] * bath.kT);
        }
        return c;
    }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
