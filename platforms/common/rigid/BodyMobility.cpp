#include "rigid/BodyMobility.h"

#include <Eigen/Geometry>

#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

const Placement& BodyMobility::placementOf(const vector<Pose>& at) {
    setTurns(at, askedTurns);
    asked.box = bodies.getBox();
    bodies.getMotion().place(at, askedTurns, asked);
    return asked;
}

string BodyMobility::objection(const vector<Pose>& at) {
    if (!mayObject()) return {};
    string found = bodies.getModel().objection(placementOf(at));
    if (!found.empty() || !bodies.getForcesOnFluid()) return found;
    bodies.getForcesOnFluid()->place(at, askedTurns, asked);
    found = bodies.getForcesOnFluid()->getModel().objection(asked);
    return found.empty() ? found
                         : "at the site of a force on the fluid (addBodyForceOnFluid()): " + found;
}

bool BodyMobility::acceptsNearby(const vector<Pose>& at) {
    return !mayObject() || bodies.getModel().acceptsNearby(placementOf(at));
}

void BodyMobility::flowSlips(const DrivenFlow& flow, MatrixXd& slips) {
    if (!bodies.hasModel()) {
        slips.resize(bodies.getNumRows(), 1);
        for (size_t e = 0; e < bodies.getElements().size(); e++) {
            slips.block<3, 1>(bodies.firstRow(e), 0) = flow.velocityAt(getPoses()[e].R, {});
            slips.block<3, 1>(bodies.firstRow(e) + 3, 0) =
                flow.angularVelocityAt(getPoses()[e].R, {});
        }
        return;
    }
    BodiesAt& here = particlesHere();
    if (!slipSpace.areOfBodies() || bodies.getMotion().isIdentity()) {
        here.follow(flow, slips);
    } else {
        here.follow(flow, slipsOfFlow);
        forceFreeTwists(&flow, slipsOfFlow, slips);
    }
    keepSpinOf(flow, slips);
}

/**
 * A flow spins a body with slowed spin as fast as any other body. K' takes away a part of the spin,
 * relative to the spin of the fluid at the body's origin, and this method gives the part back as
 * slips.
 */
void BodyMobility::keepSpinOf(const DrivenFlow& flow, MatrixXd& slips) {
    keepSpins(
        [&](int e) {
            return Vector3d(getTurns()[e] * bodies.getElements()[e].spin.axis)
                .dot(flow.angularVelocityAt(getPoses()[e].R, {}));
        },
        slips);
}

/** @param rateOf  the spin of an element about its axis that must not be slowed, rad/ps */
template <class Rate>
void BodyMobility::keepSpins(const Rate& rateOf, MatrixXd& slips) {
    const auto& elements = bodies.getElements();
    bool any = false;
    for (const FluidElement& element : elements) any = any || element.slowsK();
    if (!any) return;
    spinsOfFlow.setZero(bodies.getNumRows(), 1);
    for (size_t e = 0; e < elements.size(); e++) {
        const SlowedSpin& spin = elements[e].spin;
        if (!elements[e].slowsK()) continue;
        spinsOfFlow.block<6, 1>(bodies.firstRow(e), 0) =
            (1 - spin.factor) * rateOf(e) * (twoRotations(getTurns()[e]) * spin.screw);
    }
    if (slipSpace.areOfBodies()) {
        slips += spinsOfFlow;
        return;
    }
    rigidSlips(getPoses(), spinsOfFlow, slipsOfSpins);
    slips += slipsOfSpins;
}

void BodyMobility::placeSites() {
    const ForcesOnFluid& forces = *bodies.getForcesOnFluid();
    placementOfSites.box = bodies.getBox();
    forces.place(getPoses(), getTurns(), placementOfSites);
    // Displaced poses may reach a little beyond what the model accepts.
    if (forces.getModel().objection(placementOfSites).empty())
        forces.getModel().place(sites, placementOfSites);
    else
        forces.getModel().placeNear(sites, placementOfSites);
    forces.forces(getTurns(), forcesOfSites);
}

void BodyMobility::addFlowOfSites(const vector<OpenMM::Vec3>& points, double factor,
                                  Velocities& velocities) {
    if (!bodies.getForcesOnFluid()) return;
    placeSites();
    sites->addFlowAt(sites->sources(forcesOfSites, nullptr), points, factor, velocities);
}

double BodyMobility::powerOfSites(const DrivenFlow& flow) {
    if (!bodies.getForcesOnFluid()) return 0;
    placeSites();
    bodies.getForcesOnFluid()->getModel().follow(flow, placementOfSites, velocitiesOfSites);
    return velocitiesOfSites.col(0).dot(forcesOfSites.col(0));
}

void BodyMobility::addActiveSlips(MatrixXd& ofParticles) {
    for (size_t e = 0; e < bodies.getElements().size(); e++) {
        const vector<Vector3d>& slips = bodies.getElements()[e].slips;
        const int first = bodies.getMotion().firstParticleRow(e);
        for (size_t i = 0; i < slips.size(); i++)
            ofParticles.col(0).segment<3>(first + 3 * i) -= getTurns()[e] * slips[i];
    }
    if (!bodies.getForcesOnFluid()) return;
    placeSites();
    sites->multiply(forcesOfSites, velocitiesOfSites);
    costs.products += bodies.hasProducts();
    ofParticles += velocitiesOfSites.topRows(ofParticles.rows());
}

void BodyMobility::activeSlips(MatrixXd& slips) {
    const bool ofBodies = slipSpace.areOfBodies() && !bodies.getMotion().isIdentity();
    MatrixXd& ofParticles = ofBodies ? slipsOfFlow : slips;
    ofParticles.setZero(bodies.getNumParticleRows(), 1);
    addActiveSlips(ofParticles);
    if (ofBodies) forceFreeTwists(nullptr, ofParticles, slips);
    keepSpins([&](int e) { return bodies.spinOfSlips(e); }, slips);
}

void BodyMobility::flowTwists(const DrivenFlow& flow, MatrixXd& twists) {
    if (slipSpace.slipsAreTwists()) {
        flowSlips(flow, twists);
        return;
    }
    flowSlips(flow, slipsOfFlow);
    noWrenches.setZero(bodies.getNumRows(), 1);
    solve(noWrenches, slipsOfFlow, twists);
}

void BodyMobility::forcesOfTwists(const MatrixXd& twists, const DrivenFlow* flow,
                                  MatrixXd& forces) {
    MatrixXd relative = twists, slips;
    if (slipSpace.areOfBodies()) {
        if (flow) {
            flowSlips(*flow, slips);
            relative -= slips;
        }
        forces = friction() * relative;
        return;
    }
    rigidSlips(getPoses(), twists, relative);
    if (flow) {
        flowSlips(*flow, slips);
        relative -= slips;
    }
    forcesOfSlips(relative, forces);
}

FlowSources BodyMobility::flowSources(const MatrixXd& forces, const DrivenFlow* flow, bool active,
                                      const Accuracy& accuracy) {
    BodiesAt& here = particlesHere();
    if (!slipSpace.areOfBodies()) return here.particles().sources(forces, flow, accuracy);
    MatrixXd wrenches = forces, ofParticles, slips;
    bodies.getOwnTensors().wrenchesForModel(here.getTurns(), wrenches);
    if (bodies.getMotion().isIdentity()) return here.particles().sources(wrenches, flow, accuracy);
    slips.setZero(bodies.getNumParticleRows(), 1);
    if (flow) here.follow(*flow, slips);
    if (active) addActiveSlips(slips);
    particleForces(wrenches, slips, ofParticles);
    return here.particles().sources(ofParticles, flow, accuracy);
}

bool BodyMobility::drawField(const NoiseStream& noise, uint32_t purpose,
                             unique_ptr<RandomField>& field) const {
    if (!slipsAreOfField()) return false;
    bodies.getModel().randomField()->draw(noise, purpose, bodies.getBox(), field);
    return true;
}

void BodyMobility::slipsOf(RandomField& field, MatrixXd& slips) {
    BodiesAt& here = particlesHere();
    field.slipsAt(here.getPlacement(), here.isNearby(), slips);
    costs.roots += !bodies.getModel().randomField()->isLocal();
}

double BodyMobility::divergenceOf(RandomField& field) {
    bool known = field.hasGradients();
    // The field does not give angular velocities of spheres. For a sphere about its centre they do
    // not contribute.
    for (const FluidElement& element : bodies.getElements())
        known = known && !(element.isSphere() && element.sites[0] != Vector3d::Zero()) &&
                (element.isWhollyFree() || element.isWhollyFixed());
    return known ? divergenceByGradients(field) : divergenceByDifferences(field);
}

/**
 * The nearest twist of a body is A P A^T v, with P in the body's frame. If the body moves, v
 * changes; if it turns, v and A change. The trace is over the body's own coordinates.
 */
double BodyMobility::divergenceByGradients(RandomField& field) {
    BodiesAt& here = particlesHere();
    field.slipsAt(here.getPlacement(), here.isNearby(), fieldSlips);
    field.gradientsAt(here.getPlacement(), here.isNearby(), gradients);
    double sum = 0;
    for (size_t e = 0; e < bodies.getElements().size(); e++) {
        const FluidElement& element = bodies.getElements()[e];
        // A flow without sources moves spheres and free particles without divergence.
        if (element.isFree() || element.isSphere() || element.isWhollyFixed()) continue;
        const MatrixXd& nearest = slipSpace.nearestOfElement_body(e);
        const Matrix3d& A = here.getTurns()[e];
        const int firstRow = bodies.getMotion().firstParticleRow(e);
        const int firstParticle = bodies.getMotion().firstParticle(e);
        for (size_t i = 0; i < element.sites.size(); i++) {
            const Matrix3d P_t = A * nearest.block<3, 3>(0, 3 * i) * A.transpose(),
                           P_r = A * nearest.block<3, 3>(3, 3 * i) * A.transpose();
            const Matrix3d G =
                Map<const Matrix<double, 3, 3, RowMajor>>(&gradients(0, firstParticle + i));
            const Vector3d v = fieldSlips.col(0).segment<3>(firstRow + 3 * i),
                           arm = A * element.sites[i];
            sum += (P_t * G).trace() + (P_r * crossMatrix(v)).trace() -
                   (P_r * G * crossMatrix(arm)).trace();
        }
    }
    return sum;
}

double BodyMobility::divergenceByDifferences(RandomField& field) {
    BodiesAt& here = particlesHere();
    // The field's slips are exact functions of positions, so central differences have errors of
    // delta^2 and rounding/delta only.
    const double delta = 1e-5;
    const auto& elements = bodies.getElements();
    double sum = 0;
    for (int axis = 0; axis < 6; axis++)
        for (int side : {1, -1}) {
            asked = here.getPlacement();
            askedTurns = here.getTurns();
            const Matrix3d turn(AngleAxisd(side * delta, Vector3d::Unit(axis % 3)));
            for (size_t e = 0; e < elements.size(); e++) {
                const double step = side * delta * (axis < 3 ? bodies.length(e) : 1);
                for (size_t i = 0; i < elements[e].sites.size(); i++) {
                    OpenMM::Vec3& x = asked.positions[bodies.getMotion().firstParticle(e) + i];
                    if (axis < 3) {
                        x[axis] += step;
                    } else if (!elements[e].isFree()) {
                        const Vector3d arm = here.getTurns()[e] * elements[e].sites[i],
                                       moved = turn * arm - arm;
                        x += OpenMM::Vec3(moved[0], moved[1], moved[2]);
                    }
                }
                if (axis >= 3) askedTurns[e] = turn * askedTurns[e];
            }
            field.slipsAt(asked, true, fieldSlips);
            slipSpace.nearestTwists(askedTurns, fieldSlips, askedTwists);
            for (size_t e = 0; e < elements.size(); e++)
                if (axis < elements[e].numRows() &&
                    bodies.getFreeMotion().isFree(bodies.firstRow(e) + axis))
                    sum += side * askedTwists(bodies.firstRow(e) + axis, 0) /
                           (2 * delta * (axis < 3 ? bodies.length(e) : 1));
        }
    return sum;
}

void BodyMobility::applyToParticles(const VectorXd& forces, VectorXd& velocities) {
    const HydrodynamicParticles& particles = bodies.getParticles();
    if (particles.size() == 0) return;
    MatrixXd f = MatrixXd::Zero(particles.numRows, 1), u;
    for (int i = 0; i < particles.size(); i++)
        f.middleRows<3>(particles.firstRow[i]) = forces.segment<3>(3 * particles.systemIndex[i]);
    particlesHere().particles().multiply(f, u);
    costs.products += bodies.hasProducts();
    for (int i = 0; i < particles.size(); i++)
        velocities.segment<3>(3 * particles.systemIndex[i]) =
            u.middleRows<3>(particles.firstRow[i]);
}

}  // namespace RigidHIPlugin
