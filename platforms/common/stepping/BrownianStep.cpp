#include "stepping/BrownianStep.h"

#include "schemes/OverdampedSchemes.h"
#include "stepping/NonFinite.h"

namespace RigidHIPlugin {

void BrownianStep::take() {
    Scene& scene = parts.scene;
    Fluid& fluid = *scene.fluid.get();
    const OverdampedEntry& scheme = overdampedScheme(scene.settings.scheme);
    fluid.beginOverdamped(
        scene.settings.scheme);  // first: whatever fails from here on restores what this keeps
    if (scheme.needsForces(0)) fluid.checkTorques(scene.bodies, scene.arrays->forces());
    for (int stage = 0; stage < scheme.numStages(); stage = fluid.nextStage()) {
        if (stage > 0) {
            fluid.showStage(stage, scene.bodies, scene.arrays->positions());
            writePositions();
            parts.forces.evaluate(scene.arrays->getTime() +
                                  scheme.forcesAt[stage] * scene.settings.h);
            fluid.checkTorques(scene.bodies, scene.arrays->forces());
        }
        runStage(stage);
    }
    writePositions();
    fluid.endOverdamped();
}

/**
 * Run a stage. Groups that it led to where the model has no mobility are then at the start of the
 * step again.
 */
void BrownianStep::runStage(int stage) {
    Scene& scene = parts.scene;
    const double start = StepCounters::now();
    const LoopResult result = scene.fluid->runStage(
        stage, scene.settings, scene.bodies, *scene.freeParticles, scene.arrays->positions());
    scene.counters.seconds_mobility += StepCounters::now() - start;
    scene.counters.randomNumbers += result.randomNumbers;
    parts.forces.drop();  // poses have changed
    if (!result.finite) reportNonFinite(scene, "position");
    const Fluid::Rejections rejected = scene.fluid->takeBackRejected(
        parts.start.bodies(), parts.start.freeParticles(), scene.bodies, *scene.freeParticles,
        scene.arrays->positions());
    if (rejected.number > 0)
        parts.rejections.count(rejected.number, rejected.attempts, rejected.objection);
}

void BrownianStep::writePositions() {
    parts.mirror.run(BodyLoop::ScatterPositions);
    parts.mirror.placeFreeVirtualSites();
}

}  // namespace RigidHIPlugin
