// Fluid: the effect on momenta in a step of LangevinHI.

#include <functional>

#include "fluid/Fluid.h"
#include "linearalgebra/OneBlasThread.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

Thermostat Fluid::bodyThermostat(int body, const BodyInertia& inertia, double kT, double h) const {
    const FluidGroup& group = *groups[groupOfBody[body]];
    if (!group.isThermostat) return {};
    double rates[3] = {0, 0, 0};
    for (int k = 0; k < 3; k++)
        if (inertia.isLive(k)) rates[k] = group.drag_r[k] / inertia.moments[k];
    return ornsteinUhlenbeckCoefficients(inertia, group.drag_t / inertia.mass, rates, kT, h);
}

bool Fluid::freeThermostat(int freeParticle, double mass, double kT, double h,
                           Thermostat& thermostat) const {
    if (groupOfFree[freeParticle] < 0) return false;
    thermostat = Thermostat();
    const FluidGroup& group = *groups[groupOfFree[freeParticle]];
    if (!group.isThermostat) return true;
    setOrnsteinUhlenbeck(mass, group.drag_t / mass, kT, h, thermostat.decay_p, thermostat.noise_p);
    return true;
}

LoopResult Fluid::relax(double h, double kT, const NoiseStream& noise, BodySet& bodies,
                        const FreeParticles& freeParticles, const vector<OpenMM::Vec3>& positions,
                        vector<OpenMM::Vec3>& velocities) {
    const OneBlasThread single;
    const RelaxationStep step{h, kT, noise, bodies, freeParticles, velocities, loops, driven};
    const auto task = [&](int i) {
        FluidGroup& group = *coupledGroups[i];
        group.relaxation->relax(group.readPoses(bodies, positions), step);
    };
    if (operationsPerStep > worthThreads)
        loops.forTasks(coupledGroups.size(), cref(task));
    else
        for (size_t i = 0; i < coupledGroups.size(); i++) task(i);
    LoopResult result;
    for (const FluidGroup* group : coupledGroups) {
        result.randomNumbers += group->relaxation->getNumRandomNumbers();
        numSquareRoots += kT > 0;
        numIterations += group->relaxation->getNumIterations();
        result.finite = result.finite && group->relaxation->isFinite();
    }
    return result;
}

}  // namespace RigidHIPlugin
