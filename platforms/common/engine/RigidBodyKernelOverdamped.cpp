// RigidBodyKernel: steps without momenta.

#include "engine/RigidBodyKernel.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

/**
 * Predict, forces in between where the scheme has them, correct. A group of bodies that is led to where the model has no mobility is redone
 * by itself with new noise, so that what a step costs does not grow faster than the number of groups.
 *
 * Groups that are redone after Correct want forces in between again, and OpenMM evaluates those of all: the others stand where theirs
 * were evaluated then, and keep the ends that they have reached. If OpenMM forces act between groups, these have felt the poses
 * that were rejected.
 */
void RigidBodyKernel::takeOverdampedStep(ContextImpl& context) {
    const OverdampedScheme& scheme = overdampedScheme(settings.scheme);
    if (scheme.forcesAtStart) fluid->checkTorques(bodies, *data.forces);
    fluid->beginOverdamped();
    do {
        while (!goOverdamped(OverdampedPart::Predict)) {
        }
        if (scheme.forcesInBetween) fluid->showInBetween(bodies, positions());
        scatterOverdamped(context);
        if (!scheme.forcesInBetween) return;
        calculateForces(context);
        if (!freeParticles->gatherForces(*data.forces)) reportNonFinite("force");
        if (!runLoop(BodyLoop::GatherForces).finite) reportNonFinite("force");
        addBodyForces(context, data.time + scheme.timeOfForces(settings.h), 0);
        fluid->checkTorques(bodies, *data.forces);
    } while (!goOverdamped(OverdampedPart::Correct));
    scatterOverdamped(context);
}

/** @return whether the model has a mobility wherever this led; if not, what was led astray is at the start of the step again */
bool RigidBodyKernel::goOverdamped(OverdampedPart part) {
    const double start = now();
    const LoopResult result =
        fluid->runOverdamped(part, overdampedScheme(settings.scheme), settings, bodies, *freeParticles, positions());
    counters.seconds_mobility += now() - start;
    counters.randomNumbers += result.randomNumbers;
    forcesAreValid = false;
    if (!result.finite) reportNonFinite("position");
    const Fluid::Rejections rejected =
        fluid->takeBackRejected(bodySnapshot, freeSnapshot, bodies, *freeParticles, positions());
    if (rejected.number == 0) return true;
    counters.rejectedSteps += rejected.number;
    reportTooManyRejections(rejected.objection, rejected.attempts);
    return false;
}

void RigidBodyKernel::scatterOverdamped(ContextImpl& context) {
    runLoop(BodyLoop::ScatterPositions);
    placeFreeVirtualSites(context);
}

}  // namespace RigidHIPlugin
