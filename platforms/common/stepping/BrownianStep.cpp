#include "stepping/BrownianStep.h"

#include "schemes/OverdampedSchemes.h"
#include "stepping/NonFinite.h"

namespace RigidHIPlugin {

void BrownianStep::take() {
    Scene& scene = parts.scene;
    BrownianGroups& groups = scene.fluid->getBrownianGroups();
    const FluidChecks& checks = scene.fluid->getChecks();
    const OverdampedEntry& scheme = overdampedScheme(scene.settings.scheme);
    findPrescribed();
    // First: whatever fails from here on restores what this keeps.
    groups.begin(scene.settings.scheme);
    if (scheme.needsForces(0)) checks.checkTorques(scene.bodies, scene.arrays->forces());
    for (int stage = 0; stage < scheme.numStages(); stage = groups.nextStage()) {
        if (stage > 0) {
            groups.showStage(stage, scene.bodies, scene.arrays->positions());
            writePositions();
            parts.forces.evaluate(scene.arrays->getTime() +
                                  scheme.forcesAt[stage] * scene.settings.h);
            checks.checkTorques(scene.bodies, scene.arrays->forces());
        }
        runStage(stage);
    }
    writePositions();
    groups.end();
}

/** Evaluate prescribed velocities at the times of all stages, before anything has moved. */
void BrownianStep::findPrescribed() {
    Scene& scene = parts.scene;
    prescribed.clear();
    if (!scene.bodyMotions.isOn()) return;
    const OverdampedEntry& scheme = overdampedScheme(scene.settings.scheme);
    prescribed.resize(scheme.numStages());
    for (int stage = 0; stage < scheme.numStages(); stage++) {
        const double part = stage == 0 ? 0 : scheme.forcesAt[stage];
        scene.bodyMotions.evaluate(scene.contextParameters,
                                   scene.arrays->getTime() + part * scene.settings.h,
                                   prescribed[stage]);
    }
}

/**
 * Run a stage. Groups that it led to where the model has no mobility are then at the start of the
 * step again.
 */
void BrownianStep::runStage(int stage) {
    Scene& scene = parts.scene;
    BrownianGroups& groups = scene.fluid->getBrownianGroups();
    const double start = StepCounters::now();
    const LoopResult result =
        groups.runStage(stage, scene.settings, prescribed.empty() ? nullptr : &prescribed[stage],
                        scene.bodies, *scene.freeParticles, scene.arrays->positions());
    scene.counters.seconds_mobility += StepCounters::now() - start;
    scene.counters.add(result);
    parts.forces.drop();  // poses have changed
    if (!result.finite) reportNonFinite(scene, "position");
    const BrownianGroups::Rejections rejected =
        groups.takeBackRejected(parts.start.bodies(), parts.start.freeParticles(), scene.bodies,
                                *scene.freeParticles, scene.arrays->positions());
    if (rejected.number > 0)
        parts.rejections.count(rejected.number, rejected.attempts, rejected.objection);
}

void BrownianStep::writePositions() {
    parts.mirror.run(BodyLoop::ScatterPositions);
    parts.mirror.placeFreeVirtualSites();
}

}  // namespace RigidHIPlugin
