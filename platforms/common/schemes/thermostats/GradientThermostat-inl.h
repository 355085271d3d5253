// The gradient (Brownian) thermostat.
//
// Equation:  dR = upsilon/m f dt + sqrt(2 upsilon kT/m) dw,
//            dQ = Upsilon/M F dt + sqrt(2 Upsilon kT/M) sum_l S_l Q * dW_l (Stratonovich),
//            M = 4 / sum_k 1/I'_k, with I'_k as in Langevin A.
// Method:    Euler for R; Q <- exp(Y) Q,
//            Y = h Upsilon/M (F Q^T - Q F^T) + sqrt(2 h Upsilon kT/M) sum_l eta_l S_l.
//            A skew 4x4 matrix is the sum of a left and a right quaternion product, and these two
//            commute. With F = 2 Q (0, tau_body) this gives exp(Y) Q = exp(a tau_lab) Q exp(a
//            tau_body + b eta), a = h Upsilon/M, b = sqrt(2 h Upsilon kT/M). This is the Rodrigues
//            formula of the paper's Appendix E without its degenerate cases.
// Order:     weak 1.   Cost: one force evaluation a step. No momenta.
// Reference: Davidchack, Ouldridge, Tretyakov 2015, eqs. 15, 16 and 30.
// Limits:    in water h upsilon < 150 fs^2 and h Upsilon < 70 fs^2.

#if defined(RIGIDHI_GRADIENT_THERMOSTAT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_GRADIENT_THERMOSTAT_INL_H_
#undef RIGIDHI_GRADIENT_THERMOSTAT_INL_H_
#else
#define RIGIDHI_GRADIENT_THERMOSTAT_INL_H_
#endif

#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

struct GradientThermostat {
    template <class Flow, class Time>
    static void beforeForces(Flow& flow, const Time&) {
        flow.gradientMove(0);  // R_{k+1} and Q_{k+1} from the forces at k
    }
    template <class Flow, class Time>
    static void afterForces(Flow&, const Time&) {}
    static Thermostat coefficients(const BodyInertia& body, const HeatBath& bath, double h) {
        Thermostat c;
        c.move_R = h * bath.upsilon / body.mass;
        c.noise_R = std::sqrt(2 * h * bath.upsilon * bath.kT / body.mass);
        for (int k = 0; k < 3; k++) {
            if (!body.isLive(k)) continue;
            c.move_q[k] = h * bath.Upsilon / body.M();
            c.noise_q[k] = std::sqrt(2 * h * bath.Upsilon * bath.kT / body.M());
        }
        return c;
    }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
