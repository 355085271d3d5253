#ifndef RIGIDHI_MOMENTUM_FLOW_H_
#define RIGIDHI_MOMENTUM_FLOW_H_

namespace RigidHIPlugin {

/**
 * The effect of the moves of a scheme on one component of a momentum p, under a constant force f:
 *
 *     p <- factor p + time f + amplitude[0] xi_0 + amplitude[1] xi_1
 *
 * with the independent random numbers xi of the two draws of a step. The scheme's own code runs
 * over this flow, so a new scheme needs no formulas of its own here. The flow neglects that drifts
 * turn angular momenta in the body frame.
 */
class MomentumFlow {
public:
    /** @param decay, noise  the factors of this component (Thermostat) */
    MomentumFlow(double decay, double noise) : decay(decay), noise(noise) {}
    /** The moves before the first drift of a step, which lead to the mid-step momentum. */
    template <class Scheme>
    static MomentumFlow upToDrift(double decay, double noise, double h) {
        MomentumFlow flow(decay, noise);
        flow.endsAtDrift = true;
        Scheme::beforeForces(flow, h);
        return flow;
    }
    /** All moves of a step. */
    template <class Scheme>
    static MomentumFlow wholeStep(double decay, double noise, double h) {
        MomentumFlow flow(decay, noise);
        Scheme::beforeForces(flow, h);
        Scheme::afterForces(flow, h);
        return flow;
    }

    void kick(double t) {
        if (!ended) time += t;
    }
    void drift(double) { ended = ended || endsAtDrift; }
    void damp() {
        if (ended) return;
        factor *= decay;
        time *= decay;
        for (double& a : amplitude) a *= decay;
    }
    void addNoise(int draw) {
        if (!ended) amplitude[draw] += noise;
    }
    void ornsteinUhlenbeck(int draw) {
        damp();
        addNoise(draw);
    }
    void gradientMove(int) {}

    /** The variance of the noise. */
    double variance() const { return amplitude[0] * amplitude[0] + amplitude[1] * amplitude[1]; }

    double factor = 1, time = 0, amplitude[2] = {0, 0};

private:
    double decay, noise;
    bool endsAtDrift = false, ended = false;
};

}  // namespace RigidHIPlugin

#endif
