#ifndef RIGIDHI_THERMOSTAT_H_
#define RIGIDHI_THERMOSTAT_H_

#include <cmath>

#include "rigidbody/Target.h"

namespace RigidHIPlugin {

/**
 * Mass and principal moments of a body, as thermostats use them. A moment of 0 marks an axis
 * without rotation.
 */
struct BodyInertia {
    double mass = 0;
    double moments[3] = {0, 0, 0};
    bool isLive(int k) const { return moments[k] > 0; }
    /**
     * M = 4 / sum 1/I'_k over live axes (Davidchack 2015, eq. 10); 0 without live axes. Let I_0 be
     * a tenth of the middle moment. I'_k is the moment I_k, except for a moment below I_0, where it
     * is I_0^2/I_k. A body with a vanishing moment thereby has the M of a linear body. With I_k
     * itself, M would be about 4 I_1: nothing would damp the tumbling of a body that is straight to
     * the decimals of its file, and no step would resolve its motion under the gradient thermostat.
     * Any constant rates keep equipartition.
     */
    double M() const {
        double sum = 0;
        for (int k = 0; k < 3; k++)
            if (isLive(k))
                sum += isThin(k) ? moments[k] / (thinMoment() * thinMoment()) : 1 / moments[k];
        return sum > 0 ? 4 / sum : 0;
    }
    /**
     * The rate Gamma M/(4 I_k) at which l_k relaxes; about a thin axis, the rate with the moment
     * I_0.
     */
    double rotationalRate(int k, double Gamma) const {
        if (!isThin(k)) return Gamma * M() / (4 * moments[k]);
        double others = 0;
        for (int i = 0; i < 3; i++)
            if (isLive(i) && i != k) others += 1 / moments[i];
        return Gamma / (1 + thinMoment() * others);
    }
    /** Whether some rate differs from that of the moments themselves. */
    bool isElongated() const { return isThin(0) || isThin(1) || isThin(2); }

private:
    /**
     * I_0. The smallest moment of water is 0.46 of the middle one, that of benzene 1, so this
     * concerns rods only.
     */
    double thinMoment() const { return 0.1 * middleMoment(); }
    bool isThin(int k) const { return isLive(k) && moments[k] < thinMoment(); }
    double middleMoment() const {
        const double* I = moments;
        return std::fmax(std::fmin(I[0], I[1]), std::fmin(std::fmax(I[0], I[1]), I[2]));
    }
};

/** The heat bath of a body: temperature, frictions (Langevin) and mobilities (gradient). */
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
 * The factors of the Ornstein-Uhlenbeck process for the momentum and the live angular momenta of a
 * body, at these rates.
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

/** The same factors with a heat bath's rates: gamma, and those of rotationalRate(). */
inline Thermostat ornsteinUhlenbeckCoefficients(const BodyInertia& body, const HeatBath& bath,
                                                double t) {
    double rates[3] = {0, 0, 0};
    for (int k = 0; k < 3; k++)
        if (body.isLive(k)) rates[k] = body.rotationalRate(k, bath.Gamma);
    return ornsteinUhlenbeckCoefficients(body, bath.gamma, rates, bath.kT, t);
}

}  // namespace RigidHIPlugin

#endif
