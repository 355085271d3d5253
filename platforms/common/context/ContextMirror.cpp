#include "context/ContextMirror.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>

#include "context/Messages.h"
#include "context/Resuming.h"
#include "context/StateHash.h"
#include "fluid/StepResolution.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

ContextMirror::ContextMirror(Scene& scene)
    : scene(scene), lastPositions(scene.system.getNumParticles()), lastVelocities(lastPositions) {}

LoopResult ContextMirror::run(BodyLoop loop) {
    static_assert(sizeof(Vec3) == 3 * sizeof(double),
                  "the loops take arrays of Vec3 as arrays of doubles");
    ContextArrays& arrays = *scene.arrays;
    return scene.loops->run(loop, scene.bodies, scene.settings,
                            {&arrays.positions()[0][0], &arrays.velocities()[0][0],
                             reinterpret_cast<const double*>(arrays.forces().data()),
                             lastPositions.data(), lastVelocities.data()});
}

void ContextMirror::requirePositions(const char* what) const {
    if (!positionsAreSet)
        fail(string(what) +
             " needs positions: call setPositions() on the Context first; for setBodyPositions() "
             "and setBodyOrientations(), positions of unrotated bodies suffice");
}

void ContextMirror::forgetWritten() {
    if (loaded) scene.noiseHistory.loadedWasCompared(false);
    loaded.reset();
    lastPositions.forgetAll();
    lastVelocities.forgetAll();
    setSinceStep = true;
    scene.energyIsUnchecked = true;
}

void ContextMirror::positionsWereSet() {
    scene.watch.restart();
    if (scene.fluid) interruptWatches(scene.fluid->getContents());
    positionsAreSet = true;
    scene.energyIsUnchecked = true;
    boxIsOfStep = false;
    if (loaded) {
        // OpenMM reads the positions of a checkpoint after its bodies. Where positions and bodies
        // contradict, positions count.
        unique_ptr<Loaded> judged(move(loaded));
        scene.arrays->pullPositions();
        checkPosesAgainstPositions(scene, judged->saved);
        loaded = move(judged);
    }
    setSinceStep = true;
}

void ContextMirror::velocitiesWereSet() {
    scene.watch.restart();
    setSinceStep = true;
    scene.arrays->pullVelocities();
    // OpenMM then applies velocity constraints. The mirror takes in their changes as usual.
    if (drawn.takeIn(scene)) lastVelocities.remember(scene.arrays->velocities());
}

void ContextMirror::stateWasLoaded(const SavedState& saved, const vector<int>& toBeFitted) {
    scene.watch.restart();
    // Arrays that differ from the saved ones count as changed by the user.
    lastPositions.forgetAll();
    lastVelocities.forgetAll();
    boxIsOfStep = false;
    loaded = make_unique<Loaded>(Loaded{saved, toBeFitted});
}

// -------------------------------------------------------------------------------------------------
// Taking in changes of the Context by others

void ContextMirror::takeInBox() {
    const BoxVectors box = scene.getBox();
    if (memcmp(box.data(), lastBox.data(), sizeof box) == 0) return;
    scene.noteChange();
    lastBox = box;
}

void ContextMirror::setBox(const BoxVectors& box) {
    boxIsOfStep = true;
    boxOfStep = box;
    if (memcmp(box.data(), lastBox.data(), sizeof box) == 0) return;
    const Vec3 vectors[3] = {box[0], box[1], box[2]};
    scene.arrays->setBox(vectors);
    scene.fluid->setBox(box);
    lastBox = box;
}

void ContextMirror::checkBoxOfShear() const {
    if (!boxIsOfStep || !scene.fluid || !scene.fluid->getContents().userFlow.isSheared()) return;
    const BoxVectors box = scene.getBox();
    if (memcmp(box.data(), boxOfStep.data(), sizeof box) == 0) return;
    constexpr ErrorsOf fail{"MobilityForce"};
    fail("the last step left " + textOf(boxOfStep) +
         " of a sheared fluid (setShear()), and the Context now has " + textOf(box) +
         ", although no positions were set since; the box tilts with the flow and must go on from "
         "its last vectors: set it back by setPeriodicBoxVectors(), load a State or "
         "checkpoint, or set positions after the box to start from there");
}

void ContextMirror::takeInChanges(bool stepping) {
    ContextArrays& arrays = *scene.arrays;
    takeInBox();
    arrays.pullPositions();
    arrays.pullVelocities();
    // Look at everything before taking anything in.
    const bool newPositions = !lastPositions.is(arrays.positions()),
               newVelocities = !lastVelocities.is(arrays.velocities());
    if (newPositions) requireFinite(arrays.positions(), "position", "nm");
    if (newVelocities) requireFinite(arrays.velocities(), "velocity", "nm/ps");
    if (!scene.isBuilt()) scene.buildFromPositions();
    scene.adoptInertia();
    if (stepping) scene.fluid.adoptBox();
    if (loaded) takeInLoaded();
    if (newPositions && !lastPositions.is(arrays.positions())) takeInPositions();
    if (newVelocities && !lastVelocities.is(arrays.velocities()))
        takeInVelocities(stepping && scene.settings.hasMomenta());
    takeInHeld();
}

/** If other bodies or particles are held than before, give particles the velocities of bodies. */
void ContextMirror::takeInHeld() {
    if (heldChanges == scene.numHeldChanges()) return;
    heldChanges = scene.numHeldChanges();
    owed = max(owed, Owed::Twists);
}

/** Velocities must be finite too: schemes without momenta keep them for a later scheme. */
void ContextMirror::requireFinite(const vector<Vec3>& array, const char* quantity,
                                  const char* unit) const {
    double sum = 0;
    for (const Vec3& x : array) sum += x[0] + x[1] + x[2];
    for (int p = 0; !isfinite(sum) && p < (int)array.size(); p++)
        if (!isFinite(array[p])) {
            const int body = scene.stock.bodyOfParticle[p];
            const string other = "particle " + to_string(p) + ", which is in no body,";
            fail((body >= 0 ? "body " + to_string(body) + ": particle " + to_string(p) : other) +
                 " has the " + quantity + " " + text(array[p]) + " " + unit +
                 ", which is not finite" +
                 (&array == &scene.arrays->positions() && scene.system.isVirtualSite(p)
                      ? "; it is a virtual site: call computeVirtualSites() on the Context after "
                        "setPositions()"
                  : body < 0 || !scene.definitions.hasRedundantConstraints(body)
                      ? "; give all particles of the Context finite numbers"
                  : &array == &scene.arrays->positions()
                      ? whatMakesNanOfBodies
                      : "; set finite velocities by the Context's setVelocities(), without "
                        "setVelocitiesToTemperature(), in which OpenMM makes NaN of a body with "
                        "redundant constraints"));
        }
}

void ContextMirror::takeInVelocitiesIfChanged() {
    if (scene.isBuilt() && !loaded) {
        scene.adoptInertia();
        scene.arrays->pullVelocities();
        if (lastVelocities.is(scene.arrays->velocities())) return;
    }
    takeInChanges();
}

/**
 * Take in a loaded state. If the Context's arrays are those that the state was saved with, the
 * state is used unchanged.
 */
void ContextMirror::takeInLoaded() {
    const vector<Vec3>&positions = scene.arrays->positions(),
          &velocities = scene.arrays->velocities();
    const Rounding rounding = loaded->saved.rounding + scene.arrays->rounding();
    bool agree = true;
    if (hashOf(positions) == loaded->saved.positionsHash)
        lastPositions.remember(positions);
    else
        agree = !rounding.isExact() && keepWhatAgrees(*loaded, rounding, true);
    if (hashOf(velocities) == loaded->saved.velocitiesHash)
        lastVelocities.remember(velocities);
    else if (scene.settings.hasMomenta())
        agree = !rounding.isExact() && keepWhatAgrees(*loaded, rounding, false) && agree;
    scene.noiseHistory.loadedWasCompared(agree);
    for (int b : loaded->toBeFitted)
        for (int p : scene.definitions.particles(b)) {
            lastPositions.forget(p);
            lastVelocities.forget(p);
        }
    loaded.reset();
    owed = Owed::Poses;
}

/**
 * Take in arrays that a platform has rounded since they were saved. Bodies and free particles whose
 * numbers agree with the saved numbers continue from the saved doubles.
 *
 * @param positions  whether the arrays are positions, or else velocities
 * @return whether all of them agree
 */
bool ContextMirror::keepWhatAgrees(const Loaded& loaded, const Rounding& rounding, bool positions) {
    vector<Vec3>& array = positions ? scene.arrays->positions() : scene.arrays->velocities();
    RememberedArray& last = positions ? lastPositions : lastVelocities;
    const double relative = positions ? rounding.positions : rounding.velocities,
                 beside =
                     positions ? scene.arrays->longestEdge() : scene.arrays->largestSummand(array);
    const vector<Vec3> now = array;
    // Virtual sites follow their parents.
    const auto agrees = [&](int p, const Vec3& saved) {
        return scene.system.isVirtualSite(p) || isRounded(now[p], saved, relative, beside);
    };
    // What is held now or was held then has other velocities than its momenta say.
    const auto wasHeld = [&](const vector<int>& particles) {
        return !positions &&
               all_of(particles.begin(), particles.end(), [&](int p) { return now[p] == Vec3(); });
    };
    bool all = true;
    run(positions ? BodyLoop::ScatterPositions : BodyLoop::ScatterVelocities);
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        const vector<int>& particles = scene.definitions.particles(b);
        last.wereWritten(particles);
        if (all_of(particles.begin(), particles.end(), [&](int p) { return agrees(p, array[p]); }))
            continue;
        all = all && ((!positions && scene.bodies.isHeld(b)) || wasHeld(particles));
        for (int p : particles) {
            array[p] = now[p];
            last.forget(p);
        }
    }
    for (const SavedParticle& particle : loaded.saved.particles) {
        const int p = particle.index;
        if (p < 0 || p >= (int)now.size() || scene.stock.bodyOfParticle[p] >= 0) continue;
        const Vec3& saved = positions ? particle.position : particle.velocity;
        if (!agrees(p, saved)) {
            all = all && wasHeld({p});
            continue;
        }
        array[p] = saved;
        last.remember(p, saved);
    }
    return all;
}

bool ContextMirror::bodyMembersDiffer(int body, const vector<Vec3>& now,
                                      const RememberedArray& last) const {
    for (int p : scene.definitions.particles(body))
        if (!last.is(p, now[p])) return true;
    return false;
}

namespace {

/**
 * What explains this distance of a particle from its place: the rounding of a file format, which
 * the positions of the members show, or another model of the molecule.
 */
string fromRounding(double distance, const vector<Vec3>& members) {
    // A particle is rounded by up to sqrt(3)/2 of the last decimal, and its body's pose by as much.
    const map<int, string> files = {{4, ", as in PDB files,"}, {3, ", as in .gro files,"}, {2, ""}};
    for (int decimals : {4, 3, 2}) {
        const double last = pow(10.0, -decimals);
        bool isRounded = true;
        for (const Vec3& x : members)
            for (int k = 0; k < 3; k++) {
                // Somebody may have shifted the molecule. Platforms in single precision have
                // rounded the decimals again.
                const double apart = x[k] - members[0][k],
                             rest = abs(apart - last * round(apart / last));
                isRounded = isRounded && rest <= 1e-9 + 2.4e-7 * abs(x[k]);
            }
        if (isRounded && distance <= sqrt(3.0) * last)
            return ". Rounding to " + to_string(decimals) + " decimals of nm" + files.at(decimals) +
                   " may move particles this far";
    }
    const double betweenModels = 0.02;
    if (distance <= betweenModels)
        return ". The positions may belong to another model of the molecule, with other bond "
               "lengths and angles";
    return "";
}

/** Distances of points from their centre, nm. */
vector<double> distancesFromCentre(const vector<Vec3>& points) {
    Vec3 centre;
    for (const Vec3& x : points) centre += x / points.size();
    vector<double> distances;
    for (const Vec3& x : points) distances.push_back(sqrt((x - centre).dot(x - centre)));
    return distances;
}

/**
 * The ratio of distances between positions to distances between sites, if positions seem to be in
 * another unit of length: if they have the shape of the body in another size. Else 1.
 */
double anotherUnit(const vector<Vec3>& positions, const vector<Vec3>& sites) {
    const double different = 5, deviation = 0.1, fewest = 3, roundingOfPowers = 0.02;
    const vector<double> apart = distancesFromCentre(positions), own = distancesFromCentre(sites);
    const double largest = own.empty() ? 0 : *max_element(own.begin(), own.end());
    if (!(largest > 0)) return 1;
    const double ratio = *max_element(apart.begin(), apart.end()) / largest, power = log10(ratio);
    if (!isfinite(power) || (ratio < different && ratio > 1 / different)) return 1;
    for (size_t i = 0; i < own.size(); i++)
        if (!(abs(apart[i] / ratio - own[i]) <= deviation * largest)) return 1;
    // Two particles have the right shape at any distance, also if a periodic box has torn them
    // apart.
    if (own.size() < fewest && abs(power - round(power)) > roundingOfPowers) return 1;
    return ratio;
}

}  // namespace

/** The state of a body with the pose that fits the positions of its members. */
BodyState ContextMirror::fitted(int b, double& residual) const {
    const vector<int>& particles = scene.definitions.particles(b);
    vector<Vec3> members;
    for (int p : particles) members.push_back(scene.arrays->positions()[p]);
    // Virtual sites follow their parents, and users often do not move them. The fit puts them in
    // place without a comparison.
    map<int, Vec3> positionOf;
    for (size_t i = 0; i < particles.size(); i++) positionOf[particles[i]] = members[i];
    for (size_t i = 0; i < particles.size(); i++)
        if (scene.system.isVirtualSite(particles[i]))
            members[i] = virtualSitePosition(scene.system, particles[i],
                                             [&](int parent) { return positionOf.at(parent); });
    BodyState state = scene.bodies.getState(b);
    int worst = 0;
    const double distance = scene.definitions.fit(b).fitPose(members, state, worst),
                 tolerance = scene.integrator.getPoseTolerance();
    if (!(distance <= tolerance)) {
        const string found = "body " + to_string(b) + ": particle " + to_string(particles[worst]) +
                             " is " + number(distance) +
                             " nm from its place in the body, more than the pose tolerance " +
                             number(tolerance) + " nm";
        vector<Vec3> real, sites;
        for (size_t i = 0; i < particles.size(); i++)
            if (!scene.system.isVirtualSite(particles[i])) {
                real.push_back(members[i]);
                sites.push_back(scene.definitions.geometries()[b].sites[i]);
            }
        const double ratio = anotherUnit(real, sites),
                     digit = pow(10.0, floor(log10(ratio)) - 1);  // two are enough
        if (ratio != 1)
            fail(found + "; positions seem to be in another unit of length (they are about " +
                 number(round(ratio / digit) * digit) +
                 " times as far apart as the sites): give positions and sites in nm, or as "
                 "Quantities with units");
        fail(found + fromRounding(distance, real) +
             "; give positions that fit the body's shape: whole molecules, not wrapped across the "
             "periodic box. To put its particles in their places, call "
             "openmmrigidhi.app.placeBodies()" +
             (scene.definitions.hasRedundantConstraints(b)
                  ? ", but not applyConstraints() or OpenMM's minimisers, which make NaN of its "
                    "redundant constraints"
              : scene.definitions.isFixedByConstraints(b)
                  ? ", or call applyConstraints() on the Context"
                  : "") +
             ". Or raise setPoseTolerance(), or call resetBodyGeometry() if the shape itself has "
             "changed");
    }
    residual = max(residual, distance);
    return state;
}

void ContextMirror::takeInPositions() {
    vector<pair<int, BodyState>> changed;
    double residual = 0;
    for (int b = 0; b < scene.bodies.getNumBodies(); b++)
        if (bodyMembersDiffer(b, scene.arrays->positions(), lastPositions))
            changed.emplace_back(b, fitted(b, residual));
    if (!changed.empty()) {
        poseResidual = residual;
        owed = Owed::Poses;
    }
    for (auto& bodyAndState : changed)
        scene.bodies.setState(bodyAndState.first, bodyAndState.second);
    if (scene.fluid) scene.fluid->getMemory().forget();
    lastPositions.remember(scene.arrays->positions());
    scene.noteChange();
    // The twist comes from the particles' velocities at the new pose.
    for (auto& bodyAndState : changed) takeInTwist(bodyAndState.first);
}

/**
 * @param putBack  whether particle velocities may become those of rigid bodies now, or only when a
 *     step starts
 */
void ContextMirror::takeInVelocities(bool putBack) {
    const vector<Vec3>& velocities = scene.arrays->velocities();
    // A CMMotionRemover changes all velocities at every step. One fast pass treats most bodies.
    run(putBack ? BodyLoop::TakeInAndScatterVelocities : BodyLoop::TakeInVelocities);
    if (putBack) scene.arrays->pushVelocities();
    bool slowBodies = false;
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        if (scene.bodies.blocks[scene.bodies.slot(b) / BodySet::blockSize].massesMakeTheBodies)
            continue;
        slowBodies = true;
        if (bodyMembersDiffer(b, velocities, lastVelocities)) takeInTwist(b);
    }
    if (putBack && !slowBodies) {
        for (int p : scene.stock.otherParticles) lastVelocities.remember(p, velocities[p]);
        lastVelocities.allWereWritten();
    } else {
        lastVelocities.remember(velocities);
        owed = max(owed, Owed::Twists);
    }
}

void ContextMirror::takeInTwist(int b) {
    BodySet& bodies = scene.bodies;
    if (bodies.isHeld(b)) return;  // it has no twist
    vector<Vec3> members;
    for (int p : scene.definitions.particles(b)) members.push_back(scene.arrays->velocities()[p]);
    Vec3 velocity, omega_lab = bodies.getAngularVelocity_lab(b);
    BodyState state = bodies.getState(b);
    scene.definitions.fit(b).fitTwist(members, state, velocity, omega_lab);
    state.p = velocity * bodies.inertia(b).mass;
    bodies.setState(b, state);
    bodies.setAngularVelocity_lab(b, omega_lab);
}

// -------------------------------------------------------------------------------------------------
// Writing to the Context

void ContextMirror::putMembersBack() {
    if (owed == Owed::Poses)
        writePoses();
    else if (owed == Owed::Twists && scene.settings.hasMomenta())
        writeTwists();
    owed = Owed::Nothing;
    if (scene.settings.hasMomenta()) stopHeldParticles();
}

/** Set the velocities of held particles to 0, whatever others have set. */
void ContextMirror::stopHeldParticles() {
    vector<Vec3>& velocities = scene.arrays->velocities();
    const vector<int> stopped = scene.freeParticles->stopHeld(velocities);
    bool isNew = false;
    for (int p : stopped) {
        isNew = isNew || !lastVelocities.is(p, velocities[p]);
        lastVelocities.remember(p, velocities[p]);
    }
    if (isNew) scene.arrays->pushVelocities();
}

void ContextMirror::writePoses() {
    run(BodyLoop::ScatterPositions);
    if (scene.settings.hasMomenta()) run(BodyLoop::ScatterVelocities);
    placeFreeVirtualSites();
    rememberOtherParticles();
    scene.arrays->pushPositions();
    scene.arrays->pushVelocities();
}

void ContextMirror::takeOver(bool agree) {
    run(BodyLoop::ScatterPositions);
    if (scene.settings.hasMomenta()) run(BodyLoop::ScatterVelocities);
    placeFreeVirtualSites();
    rememberOtherParticles();
    scene.arrays->wereWrittenThere(agree);
}

void ContextMirror::writeTwists() {
    run(BodyLoop::ScatterVelocities);
    scene.arrays->pushVelocities();
}

void ContextMirror::rememberFreeVelocities() {
    for (int p : scene.freeParticles->getParticles())
        lastVelocities.remember(p, scene.arrays->velocities()[p]);
}

void ContextMirror::placeFreeVirtualSites() {
    if (!scene.stock.hasFreeVirtualSites) return;
    scene.arrays->computeVirtualSites();
    // OpenMM has also placed the virtual sites in bodies, with other rounding. These differences
    // are no change by others.
    for (int p : scene.stock.virtualSites) lastPositions.remember(p, scene.arrays->positions()[p]);
}

void ContextMirror::rememberOtherParticles() {
    for (int p : scene.stock.otherParticles) {
        lastPositions.remember(p, scene.arrays->positions()[p]);
        lastVelocities.remember(p, scene.arrays->velocities()[p]);
    }
}

}  // namespace RigidHIPlugin
