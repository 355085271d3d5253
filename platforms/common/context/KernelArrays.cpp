#include "context/KernelArrays.h"

#include <openmm/OpenMMException.h>
#include <openmm/Platform.h>
#include <openmm/kernels.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "context/Messages.h"
#include "context/StateHash.h"
#include "rigidbody/VirtualSitePosition.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * OpenMM's device platforms report their precision by a property. A platform without this property
 * counts as one that keeps doubles.
 */
Rounding roundingOf(ContextImpl& context) {
    const Platform& platform = context.getPlatform();
    const vector<string>& names = platform.getPropertyNames();
    if (find(names.begin(), names.end(), "Precision") == names.end()) return Rounding();
    const string precision = platform.getPropertyValue(context.getOwner(), "Precision");
    // The platform wraps and unwraps positions when it sorts particles: three roundings of half a
    // unit, and as much again as margin. In double precision the device also computes them in
    // another order than the host.
    const double few = 4, single = few * pow(2, -24), dual = 16 * few * pow(2, -53);
    Rounding rounding;
    rounding.positions =
        precision == "double" ? dual : single;  // "mixed" sorts in single precision
    rounding.velocities = precision == "single" ? single : dual;
    return rounding;
}

/** Take over entries that differ from what the platform was given. */
void takeChanged(const vector<Vec3>& now, double rounding, double beside, vector<Vec3>& shown,
                 vector<Vec3>& own) {
    if (sameBits(now, shown)) return;
    for (size_t p = 0; p < now.size(); p++)
        if (memcmp(&now[p], &shown[p], sizeof(Vec3)) != 0 &&
            !isRounded(now[p], shown[p], rounding, beside))
            own[p] = shown[p] = now[p];
}

}  // namespace

KernelArrays::KernelArrays(ContextImpl& context)
    : ContextArrays(ownPositions, ownVelocities, ownForces), context(context), sizes(0.001),
      buffers(context.getPlatform().createKernel(IntegrateVerletStepKernel::Name(), context)),
      handle(context.getPlatform().createKernel(UpdateStateDataKernel::Name(), context)),
      rounding_(roundingOf(context)),
      isPeriodic(context.getSystem().usesPeriodicBoundaryConditions()),
      seesImages(isPeriodic && forceThatSeesImages(context) >= 0), acting(context.getSystem()) {
    const System& system = context.getSystem();
    buffers.getAs<IntegrateVerletStepKernel>().initialize(system, sizes);
    kernel().initialize(system);
    const int n = system.getNumParticles();
    for (auto* array : {&ownPositions, &ownVelocities, &ownForces, &read, &positionsThere.shown,
                        &velocitiesThere.shown})
        array->resize(n);
    for (int p = 0; p < n; p++)
        if (system.isVirtualSite(p)) virtualSites.push_back(p);
    const double coarse = 1e-10;
    if (isPeriodic && rounding_.positions > coarse) images = make_unique<PeriodicImages>(context);
}

UpdateStateDataKernel& KernelArrays::kernel() const {
    return const_cast<Kernel&>(handle).getAs<UpdateStateDataKernel>();
}

void KernelArrays::pullPositions() {
    if (inSteps && positionsThere.isKnown) return;
    kernel().getPositions(context, read);
    transfers_.positionsPulled++;
    positionsThere.isImage = false;  // steps end with the real positions, and Forces act on these
    takeChanged(read, rounding_.positions, isPeriodic ? longestEdge() : 0, positionsThere.shown,
                ownPositions);
    positionsThere.isShown = positionsThere.isKnown = true;
}

void KernelArrays::pullVelocities() {
    if (inSteps && velocitiesThere.isKnown) return;
    kernel().getVelocities(context, read);
    transfers_.velocitiesPulled++;
    // OpenMM's constraints may leave any velocity at a virtual site. Such a velocity has no
    // meaning.
    for (int p : virtualSites) read[p] = velocitiesThere.shown[p];
    takeChanged(read, rounding_.velocities, largestSummand(ownVelocities), velocitiesThere.shown,
                ownVelocities);
    velocitiesThere.isShown = velocitiesThere.isKnown = true;
}

double KernelArrays::largestSummand(const vector<Vec3>& velocities) const {
    const double coarse = 1e-10;  // single precision is coarser than any sum in double precision
    double largest = 0;
    if (rounding_.velocities < coarse)
        for (const Vec3& v : velocities)
            for (int k = 0; k < 3; k++) largest = max(largest, abs(v[k]));
    return isfinite(largest) ? largest : 0;
}

void KernelArrays::pullForces() {
    kernel().getForces(context, ownForces);
    transfers_.forcesPulled++;
    for (Vec3& force : ownForces)
        for (int k = 0; k < 3; k++)
            if (!(abs(force[k]) < largestFixedPointForce))
                force[k] = numeric_limits<double>::quiet_NaN();
}

/** Platforms that sort particles by place have crashed on non-finite positions. */
void KernelArrays::requireFinite(const vector<Vec3>& array, const char* what) const {
    double sum = 0;
    for (const Vec3& x : array) sum += x[0] + x[1] + x[2];
    if (isfinite(sum)) return;
    for (size_t p = 0; p < array.size(); p++)
        if (!isFinite(array[p]))
            fail("particle " + to_string(p) + " has a non-finite " + what + ", which platform " +
                 context.getPlatform().getName() +
                 " cannot hold; set finite positions and velocities");
}

void KernelArrays::give(const vector<Vec3>& positions) {
    requireFinite(positions, "position");
    kernel().setPositions(context, positions);
    transfers_.positionsPushed++;
    if (sortMatters()) {
        kernel().setPositions(context, positions);  // OpenMM sorts at most every 250th time
        transfers_.positionsPushed++;
    }
    positionsThere.shown = ownPositions;
    positionsThere.isShown = true;
}

/** Whether the Context has these numbers, or will get them where they differ only by rounding. */
bool KernelArrays::agree(const vector<Vec3>& own, const Device& there, double relative,
                         double beside) const {
    if (sameBits(own, there.shown)) return true;
    if (!leavesRounding) return false;
    for (size_t p = 0; p < own.size(); p++)
        if (!isRounded(there.shown[p], own[p], relative, beside)) return false;
    return true;
}

void KernelArrays::pushPositions() {
    if (sortMatters()) positionsThere.isShown = false;
    if (positionsThere.isShown && !positionsThere.isImage &&
        agree(ownPositions, positionsThere, rounding_.positions, isPeriodic ? longestEdge() : 0))
        return;
    give(ownPositions);
    positionsThere.isImage = false;
}

void KernelArrays::pushPositionsForForces() {
    Vec3 box[3];
    getBox(box);
    if (!images || !images->find(ownPositions, box, imagePositions)) return pushPositions();
    if (positionsThere.isShown && positionsThere.isImage &&
        sameBits(ownPositions, positionsThere.shown))
        return;
    give(imagePositions);
    positionsThere.isImage = true;
}

void KernelArrays::pushVelocities() {
    if (inSteps && !velocitiesAreActedOn()) return;  // nobody reads them before the steps end
    if (velocitiesThere.isShown &&
        agree(ownVelocities, velocitiesThere, rounding_.velocities, largestSummand(ownVelocities)))
        return;
    requireFinite(ownVelocities, "velocity");
    kernel().setVelocities(context, ownVelocities);
    transfers_.velocitiesPushed++;
    velocitiesThere.shown = ownVelocities;
    velocitiesThere.isShown = true;
}

void KernelArrays::beginSteps() {
    inSteps = true;
    positionsThere.isKnown = velocitiesThere.isKnown = false;
}

void KernelArrays::endSteps() {
    inSteps = false;
    // Arrays that were never pulled are empty.
    if (positionsThere.isKnown) pushPositions();
    if (velocitiesThere.isKnown) pushVelocities();
}

void KernelArrays::pushEndOfStep() {
    if (!inSteps || positionsAreActedOn())
        pushPositions();  // otherwise the next force evaluation, or the end of the steps,
                          // pushes them
    pushVelocities();
}

void KernelArrays::beforeForcesAct() {
    // Earlier changes by others must be distinguished from changes by Forces.
    if (velocitiesAreActedOn() || acting.removers) pullVelocities();
    if (!positionsAreActedOn()) return;
    pullPositions();
    pushPositions();
    getBox(boxBefore);
}

void KernelArrays::afterForcesActed(bool movedParticles) {
    if (velocitiesAreActedOn())
        velocitiesThere.isKnown = false;
    else if (acting.removers)
        velocitiesThere.isShown = false;
    if (!positionsAreActedOn()) return;
    Vec3 box[3];
    getBox(box);
    if (movedParticles || memcmp(box, boxBefore, sizeof box) != 0)
        positionsThere.isKnown = false;
    else
        // A barostat that rejects its move may leave molecules shifted by the box. Such a shift is
        // no motion.
        positionsThere.isShown = false;
}

void KernelArrays::wereWrittenThere(bool agree) {
    positionsThere.shown = ownPositions;
    velocitiesThere.shown = ownVelocities;
    positionsThere.isShown = velocitiesThere.isShown = agree;
    positionsThere.isImage = false;
}

double KernelArrays::getTime() const { return kernel().getTime(context); }

void KernelArrays::setTime(double time) { kernel().setTime(context, time); }

long long KernelArrays::getStepCount() const { return kernel().getStepCount(context); }

void KernelArrays::setStepCount(long long count) { kernel().setStepCount(context, count); }

void KernelArrays::checkVirtualSites() const {
    for (int p : virtualSites) {
        const VirtualSite& site = context.getSystem().getVirtualSite(p);
        if (!turnsWithItsParents(site))
            fail("virtual site particle " + to_string(p) + " is a " + kindOf(site) +
                 ", a kind that is placed on the platforms Reference and CPU, but not on " +
                 context.getPlatform().getName() +
                 "; use one of these platforms or another kind of virtual site");
    }
}

void KernelArrays::computeVirtualSites() {
    for (int p : virtualSites)
        ownPositions[p] = virtualSitePosition(context.getSystem(), p,
                                              [&](int parent) { return ownPositions[parent]; });
}

}  // namespace RigidHIPlugin
