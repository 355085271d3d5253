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

/** Sums over bodies, apart for each place in a block, so that compilers use SIMD instructions. */
struct Sums {
    double energy[width] = {0};         // twice
    double momentum[3][width] = {{0}};  // each component, or that about each axis
    double twiceTheEnergy() const { return accumulate(energy, energy + width, 0.0); }
    double total(int k) const { return accumulate(momentum[k], momentum[k] + width, 0.0); }
};

/** Add one component of the mid-step momenta of a block. */
template <class Scheme>
void add(const BodySet::Column& momentum, const BodySet::Column& force,
         const BodySet::Column& decay, const BodySet::Column& noise, const BodySet::Column& inverse,
         double h, int firstSlot, double* energy, double* total) {
    const double *p = &momentum[firstSlot], *f = &force[firstSlot], *d = &decay[firstSlot],
                 *n = &noise[firstSlot], *inverseInertia = &inverse[firstSlot];
    for (int i = 0; i < width; i++) {
        const auto flow = MomentumFlow::upToDrift<Scheme>(d[i], n[i], h);
        const double atDrift = flow.factor * p[i] + flow.time * f[i];
        energy[i] += inverseInertia[i] * (atDrift * atDrift + flow.variance());
        total[i] += atDrift;
    }
}

template <class Scheme>
MidStepEnergies energiesOf(const BodySet& bodies, double h) {
    Sums translation, rotation;
    for (int slot = 0; slot < bodies.getNumBlocks() * width; slot += width)
        for (int k = 0; k < 3; k++) {
            add<Scheme>(bodies.p[k], bodies.force_lab[k], bodies.decay_p, bodies.noise_p,
                        bodies.inverseMass, h, slot, translation.energy, translation.momentum[k]);
            add<Scheme>(bodies.l[k], bodies.torque_body[k], bodies.decay_l[k], bodies.noise_l[k],
                        bodies.inverseMoments[k], h, slot, rotation.energy, rotation.momentum[k]);
        }
    MidStepEnergies result;
    result.translational = translation.twiceTheEnergy() / 2;
    result.rotational = rotation.twiceTheEnergy() / 2;
    for (int k = 0; k < 3; k++) result.momentum[k] = translation.total(k);
    return result;
}

}  // namespace

MidStepEnergies midStepEnergies(const BodySet& bodies, const StepSettings& settings) {
    return scalar::withThermostat(settings.scheme, [&](auto scheme) {
        return energiesOf<decltype(scheme)>(bodies, settings.h);
    });
}

FreeMomentum freeMomentum(const StepSettings& settings, double inertia, double decay,
                          double noise) {
    return scalar::withThermostat(settings.scheme, [&](auto scheme) {
        typedef decltype(scheme) Scheme;
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
