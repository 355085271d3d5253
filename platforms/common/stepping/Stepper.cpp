#include "stepping/Stepper.h"

#include <cmath>

#include "context/Messages.h"
#include "stepping/Virial.h"

using namespace OpenMM;

namespace RigidHIPlugin {

Stepper::Stepper(ContextImpl& context, Scene& scene, ContextMirror& mirror)
    : context(context), scene(scene), mirror(mirror), momentum(scene, mirror),
      forces(context, scene, mirror), start(scene, mirror), rejections(scene),
      plain({scene, mirror, forces, start, rejections}),
      withFluid({scene, mirror, forces, start, rejections}),
      overdamped({scene, mirror, forces, start, rejections}) {}

/** Tell the arrays when work on them begins and when it ends, also after an exception. */
template <class Work>
void Stepper::withArrays(const Work& work) {
    scene.arrays->beginSteps();
    try {
        work();
    } catch (...) {
        // The user must see the first error.
        try {
            scene.arrays->endSteps();
        } catch (...) {
        }
        throw;
    }
    scene.arrays->endSteps();
}

void Stepper::takeSteps(int number) {
    withArrays([&] {
        for (int i = 0; i < number; i++) takeStep();
    });
}

void Stepper::evaluateForces() {
    mirror.requirePositions("the flow of the fluid");
    withArrays([&] {
        if (scene.isBuilt()) scene.updateSettings();
        takeInChanges();
        // The next step evaluates its forces itself, so this call does not change it.
        try {
            forces.evaluate(scene.arrays->getTime());
        } catch (...) {
            forces.drop();
            throw;
        }
        forces.drop();
    });
}

Eigen::Matrix3d Stepper::findVirial() {
    Eigen::Matrix3d virial;
    withArrays([&] { virial = virialOf(context, scene); });
    return virial;
}

MidStepEnergies Stepper::findMidStepEnergies() {
    mirror.requirePositions("computeMidStepTemperature()");
    MidStepEnergies result;
    withArrays([&] {
        if (scene.isBuilt()) scene.updateSettings();
        mirror.takeInChanges();
        forces.withThoseOfNextStep([&] {
            result = midStepEnergies(scene.bodies, scene.settings);
            result.free = scene.freeParticles->midStepKineticEnergy(
                scene.settings, scene.arrays->positions(), scene.arrays->velocities(),
                scene.integrator.getConstraintTolerance());
        });
    });
    return result;
}

/** The part of a step before Forces that change the state (barostats) act. */
void Stepper::startStep() {
    mirror.requirePositions("step()");
    if (!std::isfinite(scene.arrays->getTime()))
        fail("the Context's time is " + text(scene.arrays->getTime()) +
             " ps, which is not finite; set a finite time by setTime()");
    if (scene.isBuilt()) scene.updateSettings();
    mirror.checkBoxOfShear();
    mirror.takeInBox();
    if (mirror.awaitsTakingIn()) takeInChanges();
    scene.warnings.printWaiting();
    scene.warnings.printOfBarostat(scene);
    scene.warnings.printOfFluid(scene);
    if (scene.counters.steps == 0) scene.warnings.printOfPositions(scene);
}

void Stepper::makeReady() {
    withArrays([&] {
        startStep();
        takeInChanges();
        useOwnNoise();
    });
}

/** After a State was loaded, take other random numbers if another trajectory has used these. */
void Stepper::useOwnNoise() {
    if (const auto seed = scene.noiseHistory.seedForStep(scene)) scene.settings.noise.seed = *seed;
}

void Stepper::takeStep() {
    startStep();
    const bool removal = momentum.isToBeUndone(), removesMomentum = removal && momentum.isDue();
    if (removal) {
        mirror.takeInChanges(true);
        momentum.begin();
    }
    scene.arrays->beforeForcesAct();
    const bool forcesAreInvalid = context.updateContextState();
    scene.arrays->afterForcesActed(forcesAreInvalid);
    if (forcesAreInvalid) scene.noteChange();
    StepCounters& counters = scene.counters;
    const double begin = StepCounters::now(),
                 elsewhere = counters.seconds_forces + counters.seconds_mobility;
    if (removal) momentum.undo();
    takeInChanges();
    useOwnNoise();
    if (removesMomentum) momentum.remove();
    forces.prepare();
    advance();
    counters.steps++;
    const int stepsBetweenLooks = 10;
    if (counters.steps % stepsBetweenLooks == 0) scene.warnings.printOfSteps(scene);
    counters.seconds_scheme += StepCounters::now() - begin -
                               (counters.seconds_forces + counters.seconds_mobility - elsewhere);
}

void Stepper::takeInChanges() {
    mirror.takeInChanges(true);
    mirror.putMembersBack();
    mirror.stepTookIn();
}

Step& Stepper::kindOfStep() {
    if (scene.settings.traits().isOverdamped()) return overdamped;
    if (scene.settings.needsMiddle) return withFluid;
    return plain;
}

/**
 * Run the scheme, from the forces that it begins with to new positions and velocities. If it
 * throws, nothing has changed.
 */
void Stepper::advance() {
    scene.settings.noise.attempt = 0;
    start.save();
    try {
        kindOfStep().take();
        mirror.rememberOtherParticles();
    } catch (...) {
        forces.stepFailed();
        start.putBack();
        throw;
    }
    ContextArrays& arrays = *scene.arrays;
    arrays.pushEndOfStep();
    arrays.setTime(arrays.getTime() + scene.settings.h);
    arrays.setStepCount(arrays.getStepCount() + 1);
    scene.settings.noise.step++;
    if (scene.watch.countStep())
        scene.watch.look(scene, midStepEnergiesOfMeans(scene.bodies, scene.settings));
}

}  // namespace RigidHIPlugin
