#include "stepping/Forces.h"

#include <algorithm>
#include <cmath>

#include "context/Messages.h"
#include "schemes/OverdampedSchemes.h"
#include "stepping/NonFinite.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** An evaluation of the energy takes about as long as a step. */
const long long evaluationsBetweenChecks = 10000;

}  // namespace

bool Forces::energyIsDue() {
    return scene.arrays->forcesAreFixedPoint() &&
           (scene.energyIsUnchecked || ++evaluationsSinceCheck >= evaluationsBetweenChecks);
}

void Forces::checkEnergy() {
    evaluationsSinceCheck = 0;
    const double energy =
        context.calcForcesAndEnergy(false, true, scene.integrator.getIntegrationForceGroups());
    if (!isfinite(energy))
        fail("step " + to_string(scene.arrays->getStepCount() + 1) + ": the potential energy is " +
             (isnan(energy) ? "not a number" : text(energy) + " kJ/mol") +
             " (this platform adds forces as whole numbers, so that two that are not finite "
             "may cancel); the Context keeps the state before this step: look there for particles "
             "at the same place, or take a smaller step");
    scene.energyIsUnchecked = false;
}

void Forces::prepare() {
    const StepSettings& settings = scene.settings;
    const double time = scene.arrays->getTime();
    dropIfOutOfDate(time);
    const bool overdamped = settings.traits().isOverdamped();
    if (overdamped && !overdampedScheme(settings.scheme).needsForces(0)) return;
    if (!areCurrent()) {
        evaluate(time);
        evaluatedAfter = scene.numChanges();
    } else if (!overdamped)
        renewVelocityDependent(time);
}

void Forces::dropIfOutOfDate(double time) {
    const int groups = scene.integrator.getIntegrationForceGroups();
    if (scene.bodyForces.usesTime() && scene.bodyForces.isOn(groups) && bodyForcesTime != time)
        drop();
    if (choice.changed(scene.system, groups)) drop();
}

void Forces::withThoseOfNextStep(const function<void()>& work) {
    const double time = scene.arrays->getTime();
    dropIfOutOfDate(time);
    const bool atHand = areCurrent();
    scene.bodies.saveForces(shown);
    try {
        if (atHand)
            renewVelocityDependent(time);
        else
            evaluate(time);
        work();
    } catch (...) {
        drop();
        scene.bodies.restoreForces(shown);
        throw;
    }
    if (!atHand) drop();
    scene.bodies.restoreForces(shown);
}

void Forces::calculate() {
    const double start = StepCounters::now();
    scene.arrays->pushPositionsForForces();
    context.calcForcesAndEnergy(true, false, scene.integrator.getIntegrationForceGroups());
    scene.arrays->pullForces();
    // A force that is not finite names its body, so it has precedence.
    const auto& forces = scene.arrays->forces();
    if (energyIsDue() &&
        all_of(forces.begin(), forces.end(), [](const Vec3& f) { return isFinite(f); }))
        checkEnergy();
    scene.counters.seconds_forces += StepCounters::now() - start;
    scene.counters.forceEvaluations++;
}

void Forces::evaluate(double time) {
    calculate();
    const bool freeFinite = scene.freeParticles->gatherForces(scene.arrays->forces());
    const bool bodiesFinite = mirror.run(BodyLoop::GatherForces).finite;
    if (!freeFinite || !bodiesFinite) reportNonFinite(scene, "force");
    addBodyForces(time, 0);
}

void Forces::evaluateForAfterForces(double time, double lookAhead) {
    calculate();
    if (!scene.freeParticles->gatherForces(scene.arrays->forces())) reportNonFinite(scene, "force");
    scene.settings.forcesAreGathered =
        scene.bodyForces.isOn(scene.integrator.getIntegrationForceGroups());
    if (!scene.settings.forcesAreGathered) return;
    if (!mirror.run(BodyLoop::GatherForces).finite) reportNonFinite(scene, "force");
    addBodyForces(time, lookAhead);
}

void Forces::addBodyForces(double time, double lookAhead) {
    const int groups = scene.integrator.getIntegrationForceGroups();
    scene.settings.forcesAreGathered = scene.bodyForces.isOn(groups);
    bodyForcesTime = time;
    if (scene.settings.forcesAreGathered &&
        !scene.bodyForces.add(context, scene.bodies, groups, time, lookAhead))
        reportNonFinite(scene, "force");
}

void Forces::renewVelocityDependent(double time) {
    if (!scene.bodyForces.usesVelocities() || !scene.settings.forcesAreGathered) return;
    scene.bodyForces.removeLast(scene.bodies);
    addBodyForces(time, 0);
}

void Forces::wereEvaluated() {
    scene.settings.forcesAreGathered = false;  // no CustomBodyForce has added to them
    evaluatedAfter = scene.numChanges();
}

void Forces::stepFailed() {
    // The velocities and the time at which CustomBodyForces were evaluated are no longer known.
    if (scene.settings.forcesAreGathered) drop();
}

}  // namespace RigidHIPlugin
