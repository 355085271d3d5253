#include "host/MidStep.h"

#include <cmath>
#include <numeric>

#include "schemes/MomentumFlow.h"
#include "schemes/Thermostats-inl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

const int width = BodySet::blockSize;

/**
 * A sum over bodies, with a sum for each place in a block, so that compilers use SIMD instructions.
 */
struct Sum {
    double places[width] = {0};
    double total() const { return accumulate(places, places + width, 0.0); }
};

struct OfMeans {
    static double square(const MomentumFlow&, double mean) { return mean * mean; }
};
struct OfNoise {
    static double square(const MomentumFlow& flow, double) { return flow.variance(); }
};

/**
 * Add one component of the mid-step momenta of a block.
 * @param energy  twice the kinetic energy
 * @param total   sum of the momenta; null: not wanted
 */
template <class Part, class Scheme>
void add(const BodySet::Column& momentum, const BodySet::Column& force,
         const BodySet::Column& decay, const BodySet::Column& noise, const BodySet::Column& inverse,
         double h, int firstSlot, Sum& energy, Sum* total) {
    const double *p = &momentum[firstSlot], *f = &force[firstSlot], *d = &decay[firstSlot],
                 *n = &noise[firstSlot], *inverseInertia = &inverse[firstSlot];
    for (int i = 0; i < width; i++) {
        const auto flow = MomentumFlow::upToDrift<Scheme>(d[i], n[i], h);
        const double mean = flow.factor * p[i] + flow.time * f[i];
        energy.places[i] += inverseInertia[i] * Part::square(flow, mean);
        if (total) total->places[i] += mean;
    }
}

template <class Part, class Scheme>
MidStepEnergies energiesOf(const BodySet& bodies, double h) {
    Sum translational, rotational, momentum[3];
    for (int slot = 0; slot < bodies.getNumBlocks() * width; slot += width) {
        // Forces on held bodies give them no momentum.
        if (bodies.blocks[slot / width].rotor == RotorKind::Held) continue;
        for (int k = 0; k < 3; k++) {
            add<Part, Scheme>(bodies.p[k], bodies.force_lab[k], bodies.decay_p, bodies.noise_p,
                              bodies.inverseMass, h, slot, translational, &momentum[k]);
            add<Part, Scheme>(bodies.l[k], bodies.torque[k], bodies.decay_l[k], bodies.noise_l[k],
                              bodies.inverseMoments[k], h, slot, rotational, nullptr);
        }
    }
    MidStepEnergies result;
    result.translational = translational.total() / 2;
    result.rotational = rotational.total() / 2;
    for (int k = 0; k < 3; k++) result.momentum[k] = momentum[k].total();
    return result;
}

template <class Part>
MidStepEnergies energiesOf(const BodySet& bodies, const StepSettings& settings) {
    return scalar::withThermostat(settings.scheme, [&](auto scheme) {
        return energiesOf<Part, decltype(scheme)>(bodies, settings.h);
    });
}

}  // namespace

MidStepEnergies midStepEnergiesOfMeans(const BodySet& bodies, const StepSettings& settings) {
    return energiesOf<OfMeans>(bodies, settings);
}

MidStepEnergies midStepEnergiesOfNoise(const BodySet& bodies, const StepSettings& settings) {
    return energiesOf<OfNoise>(bodies, settings);
}

MidStepEnergies midStepEnergies(const BodySet& bodies, const StepSettings& settings) {
    MidStepEnergies result = midStepEnergiesOfMeans(bodies, settings);
    const MidStepEnergies noise = midStepEnergiesOfNoise(bodies, settings);
    result.translational += noise.translational;
    result.rotational += noise.rotational;
    return result;
}

FreeMomentum freeMomentum(const StepSettings& settings, double inertia, double decay,
                          double noise) {
    return scalar::withThermostat(settings.scheme, [&](auto scheme) {
        using Scheme = decltype(scheme);
        const auto step = MomentumFlow::wholeStep<Scheme>(decay, noise, settings.h),
                   start = MomentumFlow::upToDrift<Scheme>(decay, noise, settings.h);
        FreeMomentum result;
        result.relaxation = -log(step.factor);
        if (result.relaxation > 0 && settings.kT > 0) {
            // S = factor^2 S + variance over a whole step; then the moves up to the drift.
            const double S = step.variance() / (1 - step.factor * step.factor);
            result.ratio =
                (start.factor * start.factor * S + start.variance()) / (inertia * settings.kT);
        }
        return result;
    });
}

}  // namespace RigidHIPlugin
