#include "stepping/FluidStep.h"

#include <openmm/OpenMMException.h>

#include "context/Messages.h"
#include "rigidbody/BodyPoses.h"
#include "stepping/NonFinite.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

void FluidStep::take() {
    NoiseStream& noise = parts.scene.settings.noise;
    findPrescribed();
    for (string found; !(found = attempt()).empty();) {
        const string ofMotion = objectionToPrescribed();
        if (!ofMotion.empty()) refusePrescribedMotion(ofMotion);
        parts.start.putBack();
        noise.attempt++;
        parts.rejections.count(1, noise.attempt, found);
    }
    parts.scene.fluid->getMomenta().endStep(parts.scene.bodies, *parts.scene.freeParticles);
}

/** Evaluate prescribed velocities at the times of the step, before anything has moved. */
void FluidStep::findPrescribed() {
    Scene& scene = parts.scene;
    isPrescribed = scene.bodyMotions.isOn();
    if (!isPrescribed) return;
    const double t = scene.arrays->getTime(), h = scene.settings.h;
    const auto find = [&](double part, MatrixXd& values) {
        scene.bodyMotions.evaluate(scene.contextParameters, t + part * h, values);
    };
    find(0.25, firstHalf);
    find(0.5, middle);
    find(0.75, secondHalf);
}

/**
 * Move bodies with prescribed motion for the time t, with the velocities at its middle. The motion
 * is of second order, also along axes of the body: these axes are taken at the body's orientation
 * in the middle.
 */
void FluidStep::movePrescribed(const MatrixXd& velocities, double t) {
    if (!isPrescribed) return;
    BodySet& bodies = parts.scene.bodies;
    for (const auto& [b, components] : parts.scene.bodyMotions.getPrescribed()) {
        const Vector3d V = velocities.col(b).head<3>(), W = velocities.col(b).tail<3>();
        Pose pose = poseOf(bodies, b);
        const auto toLab = [&, b = b, inBody = components.inBody](const Vector3d& v) {
            return inBody ? Vector3d(pose.rotation() * (userAxes(bodies, b) * v)) : v;
        };
        const Vector3d W_lab = toLab(W);  // rotation about W does not change it
        const auto turn = [&](double time) {
            const Vector3d half = 0.5 * time * W_lab;
            if (half.isZero(0)) return;  // keeps every bit of q
            pose.q =
                scalar::exponential(scalar::Vector3<double>{half.x(), half.y(), half.z()}) * pose.q;
        };
        turn(t / 2);
        const Vector3d V_lab = toLab(V);
        turn(t / 2);
        if (!W.isZero(0)) scalar::renormalise(pose.q);
        const int s = bodies.slot(b);
        for (int k = 0; k < 3; k++) bodies.R[k][s] += t * V_lab[k];
        bodies.q[0][s] = pose.q.w;
        bodies.q[1][s] = pose.q.x;
        bodies.q[2][s] = pose.q.y;
        bodies.q[3][s] = pose.q.z;
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
    // The next step takes its friction half a step ahead, and no noise of that step can change the
    // poses there.
    return scene.fluid->getChecks().mayObject() ? objectionHalfAStepAhead() : string();
}

string FluidStep::objection() const {
    const Scene& scene = parts.scene;
    const FluidChecks& checks = scene.fluid->getChecks();
    return checks.mayObject() ? checks.objection(scene.bodies, scene.arrays->positions())
                              : string();
}

/** As objection(), but of bodies with prescribed motion and held bodies by themselves. */
string FluidStep::objectionToPrescribed() const {
    const Scene& scene = parts.scene;
    return scene.fluid->getChecks().objectionToWhollyFixed(scene.bodies, scene.arrays->positions());
}

/**
 * @return whether the prescribed velocities after the step are known; users may still change them
 */
bool FluidStep::movePrescribedAhead() {
    if (!isPrescribed) return true;
    Scene& scene = parts.scene;
    const double h = scene.settings.h;
    try {
        scene.bodyMotions.evaluate(scene.contextParameters, scene.arrays->getTime() + 1.25 * h,
                                   ahead);
    } catch (const OpenMM::OpenMMException&) {
        return false;
    }
    movePrescribed(ahead, h / 2);
    return true;
}

string FluidStep::objectionHalfAStepAhead() {
    Scene& scene = parts.scene;
    // The next step starts with forces for the present velocities of the bodies, not for the
    // predicted velocities.
    parts.forces.renewVelocityDependent(scene.arrays->getTime() + scene.settings.h);
    scene.bodies.save(aheadBodies);
    scene.freeParticles->save(aheadFree, scene.arrays->positions(), scene.arrays->velocities());
    parts.mirror.run(BodyLoop::BeforeFriction);
    moveFree(&FreeParticles::beforeFriction);
    const bool isKnown = movePrescribedAhead();
    // If prescribed motion alone leads to bad poses, the next step reports this, if the motion is
    // still prescribed then.
    const string found = isKnown && objectionToPrescribed().empty() ? objection() : string();
    scene.bodies.restore(aheadBodies);
    scene.freeParticles->restore(aheadFree, scene.arrays->positions(), scene.arrays->velocities());
    return found;
}

/** Move up to the force evaluation: half a step, the fluid at the poses there, the other half. */
void FluidStep::moveThroughFluid() {
    Scene& scene = parts.scene;
    const StepSettings& settings = scene.settings;
    FluidMomenta& momenta = scene.fluid->getMomenta();
    momenta.beginStep(scene.bodies, *scene.freeParticles);
    LoopResult result = parts.mirror.run(BodyLoop::BeforeFriction);
    movePrescribed(firstHalf, settings.h / 2);
    result.add(moveFree(&FreeParticles::beforeFriction));
    if (!result.finite) reportNonFinite(scene, "position");
    // After an accepted step the poses ahead are known to be acceptable. This checks poses that
    // users have set.
    const string found = objection();
    if (!found.empty()) {
        const string ofMotion = objectionToPrescribed();
        parts.start.show();
        const string atStart = objection();
        if (atStart.empty() && !ofMotion.empty()) refusePrescribedMotion(ofMotion);
        fail("step " + to_string(scene.arrays->getStepCount() + 1) + ": " +
             (atStart.empty() ? "half a step ahead, where the friction is computed: " + found
                              : atStart));
    }
    const double start = StepCounters::now();
    result.add(momenta.relax(settings.h, settings.kT, settings.noise, scene.bodies,
                             *scene.freeParticles, scene.arrays->positions(),
                             scene.arrays->velocities(), isPrescribed ? &middle : nullptr));
    scene.counters.seconds_mobility += StepCounters::now() - start;
    result.add(parts.mirror.run(BodyLoop::AfterFriction));
    result.add(moveFree(&FreeParticles::afterFriction));
    movePrescribed(secondHalf, settings.h / 2);
    if (isPrescribed) parts.mirror.run(BodyLoop::ScatterPositions);
    count(result, "position");
}

}  // namespace RigidHIPlugin
