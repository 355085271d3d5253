#include "stepping/PlainStep.h"

#include "stepping/NonFinite.h"

namespace RigidHIPlugin {

void PlainStep::take() {
    LoopResult result = parts.mirror.run(BodyLoop::BeforeForces);
    result.add(moveFree(&FreeParticles::beforeForces));
    count(result, "position");
    finish();
}

void PlainStep::finish() {
    const StepSettings& settings = parts.scene.settings;
    parts.mirror.placeFreeVirtualSites();
    // Forces that depend on velocities use those at the end of the kick by h/2 with which the
    // Langevin schemes go on. The two kicks of a step are then adjoint.
    parts.forces.evaluateForAfterForces(parts.scene.arrays->getTime() + settings.h, settings.h / 2);
    LoopResult result = parts.mirror.run(BodyLoop::AfterForces);
    result.add(moveFree(&FreeParticles::afterForces));
    count(result, "force");
}

void PlainStep::count(const LoopResult& result, const char* judged) {
    if (!result.finite) reportNonFinite(parts.scene, judged);
    parts.scene.counters.add(result);
}

}  // namespace RigidHIPlugin
