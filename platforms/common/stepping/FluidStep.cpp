#include "stepping/FluidStep.h"

#include "context/Messages.h"
#include "stepping/NonFinite.h"

using namespace std;

namespace RigidHIPlugin {

void FluidStep::take() {
    NoiseStream& noise = parts.scene.settings.noise;
    for (string found; !(found = attempt()).empty();) {
        parts.start.putBack();
        noise.attempt++;
        parts.rejections.count(1, noise.attempt, found);
    }
}

/** @return why the step must be redone, or an empty string */
string FluidStep::attempt() {
    Scene& scene = parts.scene;
    moveThroughFluid();
    string found = objection();
    if (!found.empty()) return found;
    finish();
    scene.fluid->getChecks().checkTorques(scene.bodies, scene.arrays->forces());
    // The next step takes the friction half a step ahead, and no noise of that step can change the
    // poses there.
    return scene.fluid->getChecks().mayObject() ? objectionHalfAStepAhead() : string();
}

string FluidStep::objection() const {
    const Scene& scene = parts.scene;
    const FluidChecks& checks = scene.fluid->getChecks();
    return checks.mayObject() ? checks.objection(scene.bodies, scene.arrays->positions())
                              : string();
}

string FluidStep::objectionHalfAStepAhead() {
    Scene& scene = parts.scene;
    // The next step starts with forces for the present velocities of the bodies, not for the
    // predicted ones.
    parts.forces.renewVelocityDependent(scene.arrays->getTime() + scene.settings.h);
    scene.bodies.save(aheadBodies);
    scene.freeParticles->save(aheadFree, scene.arrays->positions(), scene.arrays->velocities());
    parts.mirror.run(BodyLoop::BeforeFriction);
    moveFree(&FreeParticles::beforeFriction);
    const string found = objection();
    scene.bodies.restore(aheadBodies);
    scene.freeParticles->restore(aheadFree, scene.arrays->positions(), scene.arrays->velocities());
    return found;
}

/** Move up to the force evaluation: half a step, the fluid at the poses there, the other half. */
void FluidStep::moveThroughFluid() {
    Scene& scene = parts.scene;
    const StepSettings& settings = scene.settings;
    LoopResult result = parts.mirror.run(BodyLoop::BeforeFriction);
    result.add(moveFree(&FreeParticles::beforeFriction));
    if (!result.finite) reportNonFinite(scene, "position");
    // After an accepted step the poses ahead are known to be acceptable. Here poses that users set
    // are checked.
    const string ahead = objection();
    if (!ahead.empty()) {
        parts.start.show();
        const string atStart = objection();
        fail("step " + to_string(scene.arrays->getStepCount() + 1) + ": " +
             (atStart.empty() ? "half a step ahead, where the friction is computed: " + ahead
                              : atStart));
    }
    const double start = StepCounters::now();
    result.add(scene.fluid->getMomenta().relax(
        settings.h, settings.kT, settings.noise, scene.bodies, *scene.freeParticles,
        scene.arrays->positions(), scene.arrays->velocities()));
    scene.counters.seconds_mobility += StepCounters::now() - start;
    result.add(parts.mirror.run(BodyLoop::AfterFriction));
    result.add(moveFree(&FreeParticles::afterFriction));
    count(result, "position");
}

}  // namespace RigidHIPlugin
