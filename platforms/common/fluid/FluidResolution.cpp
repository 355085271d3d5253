// Fluid: what a step resolves of the motion of each body.

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <cmath>

#include "fluid/Fluid.h"
#include "linearalgebra/OneBlasThread.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * A body that forces keep turning about an axis is told from one that noise turns as far by so many
 * standard deviations. A body that relaxes to its place turns by pi at most, which is fewer of them
 * from `leastSteps` on.
 */
const double surelyDriven = 6;
const int leastSteps = 100;

string nameOf(const FluidElement& element) {
    return element.isFree() ? "particle " + to_string(element.particles[0])
                            : "body " + to_string(element.body);
}

/** The shape of an element as a key: equal keys have equal mobilities. */
vector<double> keyOf(const FluidElement& element) {
    vector<double> key = {double(element.isFree())};
    for (size_t i = 0; i < element.sites.size(); i++)
        key.insert(key.end(), {element.sites[i][0], element.sites[i][1], element.sites[i][2],
                               element.radii[i]});
    key.insert(key.end(), element.ownMobility.data(),
               element.ownMobility.data() + element.ownMobility.size());
    return key;
}

}  // namespace

/** The mobilities of all elements of a group alone, computed once for each shape. */
void Fluid::findAlone(FluidGroup& group) const {
    if (!group.alone.empty()) return;
    const OneBlasThread single;
    const auto& elements = group.bodies.getElements();
    for (size_t e = 0; e < elements.size(); e++) {
        shared_ptr<const CoupledBodies::Alone>& known = aloneOfShapes[keyOf(elements[e])];
        if (!known) known = make_shared<CoupledBodies::Alone>(group.bodies.alone(e));
        group.alone.push_back(known);
    }
}

/** The rotations of a group's bodies in steps of the energy 2 kT h. */
void Fluid::findRotations(FluidGroup& group, double doubleEnergy) const {
    if (group.doubleEnergy == doubleEnergy) return;
    findAlone(group);
    const auto& elements = group.bodies.getElements();
    group.rotations.assign(elements.size(), BodyRotation());
    for (size_t e = 0; e < elements.size(); e++)
        if (!elements[e].isFree() &&
            !(elements[e].isSphere() && elements[e].ownMobility.size() == 0))
            group.rotations[e] = findRotation(group.alone[e]->mobility, doubleEnergy);
    group.drivenSpins.assign(elements.size(), DrivenSpin());
    group.doubleEnergy = doubleEnergy;
}

/** Slow the spins that a step of the energy 2 kT h does not resolve; 0: have the real ones. */
void Fluid::slowSpins(FluidGroup& group, double doubleEnergy) const {
    // Questions about other steps may have found the rotations of other energies since.
    if (group.energyOfMobility == doubleEnergy &&
        (doubleEnergy == 0 || group.doubleEnergy == doubleEnergy))
        return;
    group.energyOfMobility = doubleEnergy;
    BodyMobility* wanted = group.overdamped.realMobility;
    if (doubleEnergy > 0) findRotations(group, doubleEnergy);
    vector<SlowedSpin> spins;
    bool any = false;
    for (const BodyRotation& rotation : group.rotations) {
        spins.push_back(rotation.spin);
        any = any || rotation.spin.isSlowed();
    }
    if (doubleEnergy > 0 && any) {
        if (group.slowedEnergy != doubleEnergy) {
            if (group.slowed) group.costsOfFormerSlowed.add(group.slowed->mobilities.getCosts());
            group.overdamped.move.reset();
            group.slowed.reset(new SlowedBodies(group.bodies, spins, force.getSolverTolerance()));
            group.slowedEnergy = doubleEnergy;
        }
        wanted = &group.slowed->mobilities.get(wanted->getWay());
    }
    if (group.overdamped.mobility == wanted) return;
    group.overdamped.mobility = wanted;
    group.overdamped.move.reset();  // made anew when first needed
}

/** Note how the forces of this step turn slowed bodies. */
void Fluid::noteDrivenSpins(FluidGroup& group, double h, double kT) const {
    const OverdampedMove& move = *group.overdamped.move;
    for (size_t e = 0; e < group.rotations.size(); e++) {
        const BodyRotation& rotation = group.rotations[e];
        if (!rotation.spin.isSlowed()) continue;
        const Matrix3d A = move.present[e].rotation();
        const auto wrench = move.force.col(0).segment<6>(group.bodies.firstRow(e));
        const double torque = (A * rotation.spin.screw.head<3>()).dot(wrench.head<3>()) +
                              (A * rotation.spin.screw.tail<3>()).dot(wrench.tail<3>());
        DrivenSpin& driven = group.drivenSpins[e];
        driven.turn += h * rotation.fastestInStep() * torque;
        driven.variance += 2 * kT * h * rotation.fastestInStep();
        driven.steps++;
    }
}

bool Fluid::drivesSlowedSpins() const {
    for (const auto& group : groups)
        for (const DrivenSpin& driven : group->drivenSpins)
            if (driven.steps >= leastSteps &&
                abs(driven.turn) > surelyDriven * sqrt(driven.variance))
                return true;
    return false;
}

StepResolution Fluid::resolveOverdamped(double h, double kT) const {
    StepResolution result;
    result.smallestRadius = INFINITY;
    if (kT == 0) return result;
    for (const auto& group : groups) {
        findRotations(*group, 2 * kT * h);
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            for (double radius : elements[e].radii)
                result.smallestRadius = min(result.smallestRadius, radius);
            // Without turning, so that the origin does not matter.
            const SelfAdjointEigenSolver<Matrix3d> drag(
                Matrix3d(group->alone[e]->friction.topLeftCorner<3, 3>()), EigenvaluesOnly);
            const double displacement = sqrt(2 * kT * h / drag.eigenvalues()[0]);
            if (displacement > result.displacement) {
                result.displacement = displacement;
                result.mover = nameOf(elements[e]);
            }
            if (elements[e].isFree()) continue;
            const BodyRotation& rotation = group->rotations[e];
            const double fastest = rotation.spin.isSlowed() ? rotation.second
                                   : rotation.fastest > 0
                                       ? rotation.fastest
                                       : group->alone[e]->mobility(3, 3);  // a sphere
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
                result.spinner = nameOf(elements[e]);
                result.longestStepOfSpins = rotation.longestStep(kT);
            }
            const DrivenSpin& driven = group->drivenSpins[e];
            if (result.driven.empty() && driven.steps >= leastSteps &&
                abs(driven.turn) > surelyDriven * sqrt(driven.variance)) {
                result.driven = nameOf(elements[e]);
                result.longestStepOfDriven = rotation.longestStep(kT);
                result.slowing = rotation.spin.factor * rotation.spin.factor;
            }
        }
    }
    return result;
}

BodyRates Fluid::findRates(int body, const BodyInertia& inertia) const {
    FluidGroup& group = *groups[groupOfBody[body]];
    findAlone(group);
    BodyRates rates;
    const MatrixXd& friction = group.alone[elementOfBody[body]]->friction;
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

StepResolution Fluid::resolveRelaxation(double h, const BodySet& bodies,
                                        const FreeParticles& freeParticles) const {
    StepResolution result;
    const auto note = [&](double rate, bool rotation, const FluidElement& element) {
        if (h * rate <= result.relaxation) return;
        result.relaxation = h * rate;
        result.relaxationIsOfRotation = rotation;
        result.fastestToRelax = nameOf(element);
    };
    for (const auto& group : groups) {
        findAlone(*group);
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            const MatrixXd& friction = group->alone[e]->friction;
            const SelfAdjointEigenSolver<Matrix3d> drag(Matrix3d(friction.topLeftCorner<3, 3>()),
                                                        EigenvaluesOnly);
            if (elements[e].isFree()) {
                note(drag.eigenvalues()[2] / freeParticles.mass(group->freeIndex[e]), false,
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

}  // namespace RigidHIPlugin
