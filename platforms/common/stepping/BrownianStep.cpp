#include "stepping/BrownianStep.h"

#include "context/Messages.h"
#include "schemes/OverdampedSchemes.h"
#include "stepping/NonFinite.h"

namespace RigidHIPlugin {

namespace {

/** The largest strain of a step in a sheared fluid. */
const double largestStrain = 0.1;

}  // namespace

void BrownianStep::take() {
    Scene& scene = parts.scene;
    BrownianGroups& groups = scene.fluid->getBrownianGroups();
    const FluidChecks& checks = scene.fluid->getChecks();
    const OverdampedEntry& scheme = overdampedScheme(scene.settings.scheme);
    findPrescribed();
    checkStrain();
    // This comes first, because a failure from here on restores what it keeps.
    groups.begin(scene.settings.scheme);
    if (scheme.needsForces(0)) checks.checkTorques(scene.bodies, scene.arrays->forces());
    for (int stage = 0; stage < scheme.numStages(); stage = groups.nextStage()) {
        tiltBox(stage == 0 ? 0 : scheme.forcesAt[stage]);
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

bool BrownianStep::isSheared() const {
    return parts.scene.fluid->getContents().userFlow.isSheared();
}

void BrownianStep::checkStrain() const {
    if (!isSheared()) return;
    const UserFlow& flow = parts.scene.fluid->getContents().userFlow;
    const double strain = std::abs(flow.shearRate) * parts.scene.settings.h;
    if (strain <= largestStrain) return;
    constexpr ErrorsOf fail{"MobilityForce"};
    fail("a step of " + number(parts.scene.settings.h) + " ps strains the fluid by " +
         number(strain) + " at the shear rate of setShear(), " + number(flow.shearRate) +
         "/ps; it must be at most " + number(largestStrain) +
         " for bodies to follow the flow: take a smaller step, or a smaller rate");
}

/** Set the box that the shear has tilted after this part of the step. */
void BrownianStep::tiltBox(double part) {
    if (!isSheared()) return;
    const UserFlow& flow = parts.scene.fluid->getContents().userFlow;
    const BoxVectors& box = parts.start.getBox();
    parts.mirror.setBox(part == 0 ? box : flow.tilted(box, part * parts.scene.settings.h));
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
 * Run a stage. Afterwards, groups that it led to poses without mobility are at the start of the
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
    if (isSheared()) {
        const OverdampedEntry& scheme = overdampedScheme(scene.settings.scheme);
        tiltBox(stage + 1 < scheme.numStages() ? scheme.forcesAt[stage + 1] : 1);
        groups.judgeInNextBox(scene.bodies, scene.arrays->positions());
    }
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
