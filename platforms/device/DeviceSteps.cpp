#include "DeviceSteps.h"

#include <openmm/OpenMMException.h>
#include <openmm/common/ContextSelector.h>
#include <openmm/common/IntegrationUtilities.h>

#include <cstdlib>
#include <cstring>
#include <iostream>
#include <utility>

#include "context/Messages.h"
#include "context/PeriodicImages.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * How often the host reads the flag of non-finite numbers: as often as the watch of temperatures
 * looks.
 */
const int stepsBetweenLooks = 100;

/** Lets others ask whether OpenMM has sorted the particles since they asked last. */
class SortQuestion : public ComputeContext::ReorderListener {
public:
    void execute() override { isNew = true; }
    bool ask() { return exchange(isNew, false); }

private:
    bool isNew = true;  // also before the listener was there
};

bool hasHeld(const Scene& scene) {
    for (int b = 0; b < scene.definitions.getNumBodies(); b++)
        if (scene.integrator.getBodyHeld(b)) return true;
    return scene.freeParticles->getNumHeld() > 0;
}

/** Whether some particle without mass is neither in a body nor a virtual site. */
bool hasFixedParticles(const Scene& scene) {
    const System& system = scene.system;
    for (int p = 0; p < system.getNumParticles(); p++)
        if (system.getParticleMass(p) == 0 && !system.isVirtualSite(p) &&
            scene.stock.bodyOfParticle[p] < 0)
            return true;
    return false;
}

}  // namespace

DeviceSteps::DeviceSteps(unique_ptr<const Device> device, ContextImpl& context, Scene& scene,
                         ContextMirror& mirror, Stepper& stepper)
    : cc(device->getContext()), context(context), scene(scene), mirror(mirror), stepper(stepper),
      acting(context.getSystem()), imagesSeenBy(context.getSystem().usesPeriodicBoundaryConditions()
                                                    ? forceThatSeesImages(context)
                                                    : -1) {
    auto* question = new SortQuestion;  // the context owns it
    cc.addReorderListener(question);
    scene.arrays->watchSorting([question] { return question->ask(); });
    const char* const wish = getenv("RIGIDHI_BODIES_ON_HOST");
    if (wish && *wish && string(wish) != "0")
        ownReason = "the environment variable RIGIDHI_BODIES_ON_HOST is " + string(wish);
    else if (!device->hasDoubles())
        ownReason = "the device has no double precision, which poses and momenta need";
    else {
        bodies = make_unique<DeviceBodies>(move(device));
        if (imagesSeenBy >= 0) bodies->keepOutOfImages();
    }
}

string DeviceSteps::describe() const {
    return "poses and momenta stay on the device of platform " + context.getPlatform().getName() +
           ", in double precision; step(n) transfers nothing but a flag and a few sums every " +
           to_string(stepsBetweenLooks) + " steps" +
           (acting.barostats ? ", and images of particles when a barostat tries a move" : "");
}

string DeviceSteps::reasonForHost() const {
    const SchemeTraits& traits = traitsOf(scene.integrator.getScheme());
    if (!ownReason.empty()) return ownReason;
    if (traits.isOverdamped())
        return string(traits.name) + " moves bodies together with the fluid, which is on the host";
    if (!scene.isBuilt()) return "positions are not set yet";
    if (!DeviceBodies::hasBodies(scene)) return "the System has nothing to move";
    if (scene.settings.needsMiddle) return "the fluid, which is on the host, couples momenta";
    if (scene.bodyForces.isOn(scene.integrator.getIntegrationForceGroups()))
        return "the host evaluates CustomBodyForces";
    if ((acting.barostats || imagesSeenBy >= 0) && hasFixedParticles(scene)) {
        if (acting.barostats)
            return "a barostat moves particles without mass, which are in no body on the device";
        if (imagesSeenBy >= 0) return "particles without mass are in no body, and " + ofImages();
    }
    if (imagesSeenBy >= 0 && hasHeld(scene))
        return "bodies or particles are held, and " + ofImages();
    if (!acting.other.empty())
        return "the System has a Force of the kind " + acting.other +
               ", which may change positions or velocities when a step starts";
    return "";
}

string DeviceSteps::ofImages() const {
    return "force " + to_string(imagesSeenBy) +
           " is not periodic, but OpenMM moves particles into the box";
}

bool DeviceSteps::take(int number) {
    if (number <= 0 || !begin()) return false;
    for (int i = 0; i < number; i++) {
        // The host may have taken some steps again without finding an error, and then has the
        // bodies.
        if (!isHere && !begin()) {
            stepper.takeSteps(number - i);
            return true;
        }
        try {
            takeStep();
        } catch (...) {
            // Bring the bodies back to their state before this step.
            stepByHost();
            throw;
        }
        if (steps - lastLook >= stepsBetweenLooks) look();
    }
    if (isHere) look();
    return true;
}

/**
 * Bring the bodies to the device.
 *
 * @return whether the device can take the next step
 */
bool DeviceSteps::begin() {
    if (isHere && !scene.settings.areAdopted(scene.integrator)) bringBack();
    if (isHere) {
        // OpenMM does not report every change.
        mirror.takeInBox();
        scene.warnings.printOfBarostat(scene);
        if (bodies->agreeWithParticles())
            bodies->takeInVelocities();
        else
            bringBack();
    }
    if (!isHere) {
        // The kernels will write particles with all digits, so OpenMM need not get numbers that
        // differ by rounding only. It may sort particles that it gets, and a run from a checkpoint
        // would then differ in last bits.
        scene.arrays->leaveRounding(reasonForHost().empty());
        try {
            stepper.makeReady();
        } catch (...) {
            scene.arrays->leaveRounding(false);
            throw;
        }
        scene.arrays->leaveRounding(false);
    }
    if (!reasonForHost().empty()) {
        bringBack();
        return false;
    }
    if (!isHere) {
        if (!upload()) return false;
        placeVirtualSites();
        isHere = true;
    }
    bodies->setConstraintTolerance(scene.integrator.getConstraintTolerance());
    keepStart();
    return true;
}

/**
 * Give the device the bodies of the host. If it cannot hold or move them, the host keeps them from
 * now on.
 *
 * @return whether the device has the bodies
 */
bool DeviceSteps::upload() {
    try {
        bodies->upload(scene);
        return true;
    } catch (const OpenMMException& error) {
        ownReason = string("the device cannot take them: ") + error.what();
        bodies.reset();  // and its memory
        cerr << "Warning: openmm-rigidhi: the host moves bodies: " << ownReason << endl;
        return false;
    }
}

void DeviceSteps::keepStart() {
    bodies->save();
    context.getPeriodicBoxVectors(start.box[0], start.box[1], start.box[2]);
    start.time = scene.arrays->getTime();
    start.stepCount = scene.arrays->getStepCount();
    start.noiseStep = scene.settings.noise.step;
    start.counters = scene.counters;
    start.steps = lastLook = steps;
}

/** Let barostats and momentum removers act, and take in their changes. */
void DeviceSteps::letForcesAct() {
    const int evaluations = cc.getComputeForceCount();
    bool moved;
    actsOn = true;
    try {
        moved = context.updateContextState();
    } catch (...) {
        actsOn = false;
        throw;
    }
    actsOn = false;
    if (moved) scene.noteChange();
    // A barostat that has tried to change the volume has evaluated energies.
    if (acting.barostats && (moved || cc.getComputeForceCount() != evaluations)) {
        mirror.takeInBox();
        bodies->particlesWereMoved(!moved);
    }
}

/**
 * If some virtual site is in no body, OpenMM places all virtual sites, because forces belong to
 * positions as OpenMM rounds them.
 */
void DeviceSteps::placeVirtualSites() {
    if (!scene.stock.hasFreeVirtualSites) return;
    ContextSelector selector(cc);
    cc.getIntegrationUtilities().computeVirtualSites();
}

void DeviceSteps::calculateForces() {
    const double begin = StepCounters::now();
    context.calcForcesAndEnergy(true, false, scene.integrator.getIntegrationForceGroups());
    scene.counters.seconds_forces += StepCounters::now() - begin;
    scene.counters.forceEvaluations++;
}

/** A force that is not finite has stopped the bodies, and names step and body when the host looks.
 */
void DeviceSteps::checkEnergy() {
    if (stepper.getForces().energyIsDue() && !bodies->isStopped())
        stepper.getForces().checkEnergy();
}

void DeviceSteps::takeStep() {
    const double begin = StepCounters::now(), elsewhere = scene.counters.seconds_forces;
    ContextArrays& arrays = *scene.arrays;
    const double time = arrays.getTime();
    const long long stepCount = arrays.getStepCount();
    bool removes = false;
    for (int frequency : scene.stock.removalFrequencies)
        removes = removes || stepCount % frequency == 0;
    letForcesAct();
    Forces& forces = stepper.getForces();
    if (!forces.areCurrentAt(time)) {
        calculateForces();
        bodies->afterForces(scene.settings, true);
        checkEnergy();
        forces.wereEvaluated();
    }
    bodies->beforeForces(scene.settings, removes);
    placeVirtualSites();
    calculateForces();
    bodies->afterForces(scene.settings);
    checkEnergy();
    arrays.setTime(time + scene.settings.h);
    arrays.setStepCount(stepCount + 1);
    {
        ContextSelector selector(cc);
        cc.reorderAtoms();
    }
    scene.settings.noise.step++;
    steps++;
    scene.counters.steps++;
    scene.counters.randomNumbers += bodies->getRandomNumbers();
    if (scene.watch.countStep()) {
        scene.watch.look(scene, bodies->midStepEnergies());
        scene.warnings.printOfSteps(scene);
    }
    scene.counters.seconds_scheme +=
        StepCounters::now() - begin - (scene.counters.seconds_forces - elsewhere);
}

/** Check whether the steps since the last look were free of errors. */
void DeviceSteps::look() {
    if (bodies->isStopped()) {
        const long long first = start.stepCount + 1, last = first + steps - start.steps - 1;
        const bool toldOf = toldOfRepetition || !bodies->foundNonFinite();
        toldOfRepetition = toldOfRepetition || bodies->foundNonFinite();
        stepByHost();
        if (toldOf) return;
        cerr << "Warning: openmm-rigidhi: in steps " << first << " to " << last
             << " the device found a number that is not finite; the host took these steps again "
                "without finding one, and the run goes on from there"
             << endl;
    } else
        keepStart();
}

/** Take the steps since the last look again, on the host. */
void DeviceSteps::stepByHost() {
    const int number = steps - start.steps;
    bodies->restart();
    bodies->downloadSaved(scene);
    isHere = false;
    Vec3 box[3];
    context.getPeriodicBoxVectors(box[0], box[1], box[2]);
    if (memcmp(box, start.box, sizeof box) != 0)
        context.setPeriodicBoxVectors(start.box[0], start.box[1], start.box[2]);
    scene.arrays->setTime(start.time);
    scene.arrays->setStepCount(start.stepCount);
    scene.settings.noise.step = start.noiseStep;
    scene.counters = start.counters;
    scene.watch.restart();
    scene.noteChange();  // forces belong to the start, but images may differ
    mirror.takeOver(false);
    scene.arrays->pushPositions();
    scene.arrays->pushVelocities();
    try {
        stepper.takeSteps(number);
    } catch (const OpenMMException& error) {
        // In mixed precision OpenMM's setter drops digits that the particles had.
        upload();
        if (!acting.barostats || !bodies || !bodies->foundNonFinite()) throw;
        throw OpenMMException(string(error.what()) +
                              " (the device found a number that is not finite; the host took its "
                              "last steps again with other random numbers of the barostat, so step "
                              "and body may be others)");
    } catch (...) {
        upload();
        throw;
    }
}

void DeviceSteps::bringBack() {
    if (!isHere || actsOn) return;
    bodies->download(scene);
    isHere = false;
    mirror.takeOver();
}

}  // namespace RigidHIPlugin
