#include "fluid/StepResolution.h"

#include <cmath>

#include "fluid/FluidContents.h"
#include "linearalgebra/Decompositions.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

double partRedone(long long redone, long long steps, double bound) {
    // Chance accounts for up to three standard deviations of the number.
    const double errors = 3, all = double(steps) + redone;
    const int enough = 20;
    return redone >= enough && redone - errors * sqrt(double(redone)) > bound * all ? redone / all
                                                                                    : 0;
}

double partRedone(const FluidContents& fluid, double bound) {
    double largest = 0;
    for (const auto& group : fluid.groups)
        largest = max(largest, partRedone(group->brownian->getNumRejections(),
                                          group->brownian->getNumSteps(), bound));
    return largest;
}

StepResolution resolveOverdamped(const FluidContents& fluid, CustomRigidHIIntegrator::Scheme scheme,
                                 double h, double kT) {
    const SpinBounds& bounds = overdampedScheme(scheme).spins;
    StepResolution result;
    result.smallestRadius = INFINITY;
    if (kT == 0) {
        // StepWatch needs them in steps, in which groups may run at the same time.
        const size_t mostParticles = 300;  // the matrices of larger bodies take long
        for (const auto& group : fluid.groups)
            for (size_t e = 0; e < group->bodies.getElements().size(); e++)
                if (!group->bodies.getElements()[e].isWhollyFixed() &&
                    group->bodies.getElements()[e].radii.size() <= mostParticles)
                    group->alone.of(e);
        return result;
    }
    for (const auto& group : fluid.groups) {
        const vector<BodyRotation>& rotations = group->brownian->findRotations(2 * kT * h, scheme);
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            for (double radius : elements[e].radii)
                result.smallestRadius = min(result.smallestRadius, radius);
            if (elements[e].isWhollyFixed()) continue;
            // Translation without rotation, so that the origin does not matter.
            const SelfAdjointEigenSolver<Matrix3d> drag(
                Matrix3d(group->alone.of(e).friction.topLeftCorner<3, 3>()), EigenvaluesOnly);
            const double displacement = sqrt(2 * kT * h / drag.eigenvalues()[0]);
            if (displacement > result.displacement) {
                result.displacement = displacement;
                result.mover = nameOf(elements[e]);
            }
            if (elements[e].isFree()) continue;
            const BodyRotation& rotation = rotations[e];
            const double fastest = rotation.spin.isSlowed() ? rotation.second
                                   : rotation.fastest > 0
                                       ? rotation.fastest
                                       : group->alone.of(e).mobility(3, 3);  // a sphere
            const double turn = sqrt(2 * kT * h * fastest);
            if (turn > result.turn) {
                result.turn = turn;
                result.turner = nameOf(elements[e]);
            }
            if (!rotation.spin.isSlowed()) continue;
            result.numSlowed++;
            const double spin = sqrt(2 * kT * h * rotation.fastest);
            if (spin > result.spin) {
                result.spin = spin;
                result.slowedSpin = spin * rotation.spin.factor;
                result.spinner = nameOf(elements[e]);
                result.longestStepOfSpins = rotation.longestStep(kT, bounds);
            }
            if (result.driven.empty() && group->brownian->isDriven(e)) {
                result.driven = nameOf(elements[e]);
                result.longestStepOfDriven = rotation.longestStep(kT, bounds);
                result.slowing = rotation.spin.factor * rotation.spin.factor;
            }
        }
    }
    return result;
}

BodyRates findRates(const FluidContents& fluid, int body, const BodyInertia& inertia) {
    FluidGroup& group = *fluid.groups[fluid.groupOfBody[body]];
    BodyRates rates;
    const MatrixXd& friction = group.alone.of(fluid.elementOfBody[body]).friction;
    const SelfAdjointEigenSolver<Matrix3d> drag(Matrix3d(friction.topLeftCorner<3, 3>()),
                                                EigenvaluesOnly);
    rates.translation = drag.eigenvalues()[0] / inertia.mass;
    Matrix3d drag_r = friction.bottomRightCorner<3, 3>();
    for (int k = 0; k < 3; k++)
        if (!inertia.isLive(k)) {  // blobs on a line do not resist rotation about it
            drag_r.row(k).setZero();
            drag_r.col(k).setZero();
            drag_r(k, k) = 1;
        }
    const Matrix3d inverse = drag_r.inverse();
    for (int k = 0; k < 3; k++)
        if (inertia.isLive(k)) rates.rotation[k] = 1 / (inertia.moments[k] * inverse(k, k));
    return rates;
}

StepResolution resolveRelaxation(const FluidContents& fluid, double h, const BodySet& bodies,
                                 const FreeParticles& freeParticles) {
    StepResolution result;
    const auto note = [&](double rate, bool rotation, const FluidElement& element) {
        if (h * rate <= result.relaxation) return;
        result.relaxation = h * rate;
        result.relaxationIsOfRotation = rotation;
        result.fastestToRelax = nameOf(element);
    };
    for (const auto& group : fluid.groups) {
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (elements[e].isWhollyFixed()) continue;
            const MatrixXd& friction = group->alone.of(e).friction;
            const SelfAdjointEigenSolver<Matrix3d> drag(Matrix3d(friction.topLeftCorner<3, 3>()),
                                                        EigenvaluesOnly);
            if (elements[e].isFree()) {
                note(drag.eigenvalues()[2] / freeParticles.mass(group->members.freeIndex[e]), false,
                     elements[e]);
                continue;
            }
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            note(drag.eigenvalues()[2] / inertia.mass, false, elements[e]);
            Matrix3d rates = friction.bottomRightCorner<3, 3>();
            for (int k = 0; k < 3; k++) {
                const double scale = inertia.isLive(k) ? 1 / sqrt(inertia.moments[k]) : 0;
                rates.row(k) *= scale;
                rates.col(k) *= scale;
            }
            const SelfAdjointEigenSolver<Matrix3d> solver(rates, EigenvaluesOnly);
            note(solver.eigenvalues()[2], true, elements[e]);
        }
    }
    return result;
}

namespace {

template <class Get>
StepFinding largestOf(const FluidContents& fluid, const Get& get) {
    StepFinding result;
    for (const auto& group : fluid.groups) {
        const StepWatch& watch = group->brownian->getWatch();
        const StepWatch::Finding& finding = get(watch);
        if (finding.element < 0 || finding.value <= result.value) continue;
        result = {nameOf(group->bodies.getElements()[finding.element]), finding.value,
                  watch.getSmallestRadius()};
    }
    return result;
}

StepFinding presentOrPast(const StepFinding& present, StepFinding past) {
    if (!present.name.empty()) return present;
    past.isPast = true;
    return past;
}

}  // namespace

StepFinding findStiffForces(const FluidContents& fluid) {
    return presentOrPast(
        largestOf(fluid, [](const StepWatch& watch) { return watch.getStiffest(); }),
        largestOf(fluid, [](const StepWatch& watch) { return watch.getStiffestSoFar(); }));
}

StepFinding findLongDisplacements(const FluidContents& fluid) {
    return presentOrPast(
        largestOf(fluid, [](const StepWatch& watch) { return watch.getFarthest(); }),
        largestOf(fluid, [](const StepWatch& watch) { return watch.getFarthestSoFar(); }));
}

StepFinding findCrawling(const FluidContents& fluid) {
    // Replicas differ by chance only, but groups may have other bodies, of which some may move.
    for (const auto& group : fluid.groups)
        if (group->brownian->getWatch().hasMoved()) return StepFinding();
    return largestOf(fluid, [](const StepWatch& watch) { return watch.getCrawling(); });
}

void interruptWatches(const FluidContents& fluid) {
    for (const auto& group : fluid.groups) group->brownian->interruptWatch();
}

bool drivesSlowedSpins(const FluidContents& fluid) {
    for (const auto& group : fluid.groups)
        if (group->brownian->drivesSlowedSpins()) return true;
    return false;
}

double driftFactorSpread(const FluidContents& fluid) {
    double spread = 0;
    for (const auto& group : fluid.groups)
        spread = max(spread, group->brownian->getDriftFactorSpread());
    return spread;
}

}  // namespace RigidHIPlugin
