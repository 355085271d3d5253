#ifndef RIGIDHI_THERMOSTAT_H_
#define RIGIDHI_THERMOSTAT_H_

#include <cmath>

#include "rigidbody/Target.h"

namespace RigidHIPlugin {

/** Mass and principal moments of a body, as the thermostats see them. A moment of 0 marks an axis
 * without rotation. */
struct BodyInertia {
    double mass = 0;
    double moments[3] = {0, 0, 0};
    bool isLive(int k) const { return moments[k] > 0; }
    /**
     * The moment I'_k that stands for I_k in M and in the rates of the thermostats. It is I_k, but
     * at least a part of the middle moment. Any constant rates keep equipartition. With the moments
     * themselves, a body that is straight to the decimals of its file has M of about 4 I_1: then
     * its tumbling is not damped at all, and no step resolves its motion under the gradient
     * thermostat.
     */
    double momentForRates(int k) const {
        const double least = leastMomentForRates * middleMoment();
        return moments[k] < least ? least : moments[k];
    }
    /** M = 4 / sum 1/I' over live axes (Davidchack 2015, eq. 10); 0 if there are none. */
    double M() const {
        double sum = 0;
        for (int k = 0; k < 3; k++)
            if (isLive(k)) sum += 1 / momentForRates(k);
        return sum > 0 ? 4 / sum : 0;
    }
    /** The rate Gamma M/(4 I'_k) at which l_k relaxes. */
    double rotationalRate(int k, double Gamma) const {
        return Gamma * M() / (4 * momentForRates(k));
    }
    /** Whether the rates are not those of the moments themselves. */
    bool isElongated() const {
        for (int k = 0; k < 3; k++)
            if (isLive(k) && momentForRates(k) != moments[k]) return true;
        return false;
    }
    /** Water has 0.46 and benzene 1, so that only rods are changed. */
    static constexpr double leastMomentForRates = 0.1;

private:
    double middleMoment() const {
        const double* I = moments;
        return std::fmax(std::fmin(I[0], I[1]), std::fmin(std::fmax(I[0], I[1]), I[2]));
    }
};

/** What the heat bath does to a body: temperature, frictions (Langevin) and mobilities (gradient).
 */
struct HeatBath {
    double kT = 0, gamma = 0, Gamma = 0, upsilon = 0, Upsilon = 0;
};

/** The factors of one step of one body, computed once per setting. Axes without rotation have decay
 * 1 and no noise. */
struct Thermostat {
    double decay_p = 1, noise_p = 0;
    double decay_l[3] = {1, 1, 1}, noise_l[3] = {0, 0, 0};
    double move_R = 0, noise_R = 0;
    double move_q[3] = {0, 0, 0}, noise_q[3] = {0, 0, 0};
    bool hasNoise() const {
        return noise_p != 0 || noise_l[0] != 0 || noise_l[1] != 0 || noise_l[2] != 0 ||
               noise_R != 0 || noise_q[0] != 0 || noise_q[1] != 0 || noise_q[2] != 0;
    }
};

/**
 * The exact Ornstein-Uhlenbeck process of a momentum over the time t (Davidchack 2015, eqs. 25 and
 * 26): p <- exp(-rate t) p + sqrt(inertia kT (1 - exp(-2 rate t))) xi. expm1 keeps weak friction
 * exact.
 */
inline void setOrnsteinUhlenbeck(double inertia, double rate, double kT, double t, double& decay,
                                 double& noise) {
    decay = std::exp(-rate * t);
    noise = std::sqrt(-inertia * kT * std::expm1(-2 * rate * t));
}

/**
 * The factors of that process for the momentum and the live angular momenta of a body, at these
 * rates.
 */
inline Thermostat ornsteinUhlenbeckCoefficients(const BodyInertia& body, double rate_p,
                                                const double (&rates_l)[3], double kT, double t) {
    Thermostat c;
    setOrnsteinUhlenbeck(body.mass, rate_p, kT, t, c.decay_p, c.noise_p);
    for (int k = 0; k < 3; k++)
        if (body.isLive(k))
            setOrnsteinUhlenbeck(body.moments[k], rates_l[k], kT, t, c.decay_l[k], c.noise_l[k]);
    return c;
}

/** The same factors with a heat bath's frictions: gamma, and Gamma M/(4 I'_k). */
inline Thermostat ornsteinUhlenbeckCoefficients(const BodyInertia& body, const HeatBath& bath,
                                                double t) {
    double rates[3] = {0, 0, 0};
    for (int k = 0; k < 3; k++)
        if (body.isLive(k)) rates[k] = body.rotationalRate(k, bath.Gamma);
    return ornsteinUhlenbeckCoefficients(body, bath.gamma, rates, bath.kT, t);
}

}  // namespace RigidHIPlugin

#endif
