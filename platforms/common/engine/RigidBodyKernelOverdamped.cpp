// RigidBodyKernel: steps without momenta.

#include "engine/RigidBodyKernel.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

/**
 * The stages of the scheme, each with its forces. A group of bodies that is led to where the model has no mobility is redone by itself with new
 * noise, so that what a step costs does not grow faster than the number of groups.
 *
 * Groups that are redone want the forces of later stages again, and OpenMM evaluates those of all: the others stand where theirs were
 * evaluated then, and keep what they have reached. If OpenMM forces act between groups, these have felt the poses that were rejected.
 */
void RigidBodyKernel::takeOverdampedStep(ContextImpl& context) {
    const OverdampedEntry& scheme = overdampedScheme(settings.scheme);
    if (scheme.needsForces(0)) fluid->checkTorques(bodies, *data.forces);
    fluid->beginOverdamped(settings.scheme);
    for (int stage = 0; stage < scheme.numStages(); stage = fluid->nextStage()) {
        if (stage > 0) {
            fluid->showStage(stage, bodies, positions());
            scatterOverdamped(context);
            calculateForces(context);
            if (!freeParticles->gatherForces(*data.forces)) reportNonFinite("force");
            if (!runLoop(BodyLoop::GatherForces).finite) reportNonFinite("force");
            addBodyForces(context, data.time + scheme.forcesAt[stage] * settings.h, 0);
            fluid->checkTorques(bodies, *data.forces);
        }
        runStage(stage);
    }
    scatterOverdamped(context);
}

/** Groups that were led to where the model has no mobility are at the start of the step again. */
void RigidBodyKernel::runStage(int stage) {
    const double start = now();
    const LoopResult result = fluid->runStage(stage, settings, bodies, *freeParticles, positions());
    counters.seconds_mobility += now() - start;
    counters.randomNumbers += result.randomNumbers;
    forcesAreValid = false;
    if (!result.finite) reportNonFinite("position");
    const Fluid::Rejections rejected =
        fluid->takeBackRejected(bodySnapshot, freeSnapshot, bodies, *freeParticles, positions());
    if (rejected.number == 0) return;
    counters.rejectedSteps += rejected.number;
    reportTooManyRejections(rejected.objection, rejected.attempts);
}

void RigidBodyKernel::scatterOverdamped(ContextImpl& context) {
    runLoop(BodyLoop::ScatterPositions);
    placeFreeVirtualSites(context);
}

}  // namespace RigidHIPlugin
