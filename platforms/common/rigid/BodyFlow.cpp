#include "rigid/BodyFlow.h"

#include "rigid/BodyMobility.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

BodyFlow::BodyFlow(BodyMobility& mobility)
    : mobility(mobility), bodies(mobility.getBodies()), slipSpace(mobility.getSlipSpace()) {}

void BodyFlow::addActiveWrenches(MatrixXd& wrenches) const {
    if (bodies.getForcesOnFluid())
        bodies.getForcesOnFluid()->addWrenches(mobility.getTurns(), wrenches);
}

void BodyFlow::addAt(const FlowSources& sources, const vector<OpenMM::Vec3>& points, double factor,
                     Velocities& velocities) {
    mobility.particlesHere().particles().addFlowAt(sources, points, factor, velocities);
}

double BodyFlow::powerOn(const DrivenFlow& flow, const FlowSources& sources) {
    return mobility.particlesHere().powerOn(flow, sources);
}

void BodyFlow::slipsOf(const DrivenFlow& flow, MatrixXd& slips) {
    if (!bodies.hasModel()) {
        slips.resize(bodies.getNumRows(), 1);
        for (size_t e = 0; e < bodies.getElements().size(); e++) {
            slips.block<3, 1>(bodies.firstRow(e), 0) =
                flow.velocityAt(mobility.getPoses()[e].R, {});
            slips.block<3, 1>(bodies.firstRow(e) + 3, 0) =
                flow.angularVelocityAt(mobility.getPoses()[e].R, {});
        }
        return;
    }
    BodiesAt& here = mobility.particlesHere();
    if (!slipSpace.areOfBodies() || bodies.getMotion().isIdentity()) {
        here.follow(flow, slips);
    } else {
        here.follow(flow, slipsOfFlow);
        mobility.forceFreeTwists(&flow, slipsOfFlow, slips);
    }
    keepSpinOf(flow, slips);
}

/**
 * A flow spins a body with slowed spin as fast as any other body. K' takes away a part of the spin,
 * relative to the spin of the fluid at the body's origin, and this method gives the part back as
 * slips.
 */
void BodyFlow::keepSpinOf(const DrivenFlow& flow, MatrixXd& slips) {
    keepSpins(
        [&](int e) {
            return Vector3d(mobility.getTurns()[e] * bodies.getElements()[e].spin.axis)
                .dot(flow.angularVelocityAt(mobility.getPoses()[e].R, {}));
        },
        slips);
}

/** @param rateOf  the spin of an element about its axis that must not be slowed, rad/ps */
template <class Rate>
void BodyFlow::keepSpins(const Rate& rateOf, MatrixXd& slips) {
    const auto& elements = bodies.getElements();
    bool any = false;
    for (const FluidElement& element : elements) any = any || element.slowsK();
    if (!any) return;
    spinsOfFlow.setZero(bodies.getNumRows(), 1);
    for (size_t e = 0; e < elements.size(); e++) {
        const SlowedSpin& spin = elements[e].spin;
        if (!elements[e].slowsK()) continue;
        spinsOfFlow.block<6, 1>(bodies.firstRow(e), 0) =
            (1 - spin.factor) * rateOf(e) * (twoRotations(mobility.getTurns()[e]) * spin.screw);
    }
    if (slipSpace.areOfBodies()) {
        slips += spinsOfFlow;
        return;
    }
    mobility.rigidSlips(mobility.getPoses(), spinsOfFlow, slipsOfSpins);
    slips += slipsOfSpins;
}

void BodyFlow::placeSites() {
    const ForcesOnFluid& forces = *bodies.getForcesOnFluid();
    placementOfSites.box = bodies.getBox();
    forces.place(mobility.getPoses(), mobility.getTurns(), placementOfSites);
    // Displaced poses may reach a little beyond what the model accepts.
    if (forces.getModel().objection(placementOfSites).empty())
        forces.getModel().place(sites, placementOfSites);
    else
        forces.getModel().placeNear(sites, placementOfSites);
    forces.forces(mobility.getTurns(), forcesOfSites);
}

void BodyFlow::addOfSitesAt(const vector<OpenMM::Vec3>& points, double factor,
                            Velocities& velocities) {
    if (!bodies.getForcesOnFluid()) return;
    placeSites();
    sites->addFlowAt(sites->sources(forcesOfSites, nullptr), points, factor, velocities);
}

double BodyFlow::powerOfSites(const DrivenFlow& flow) {
    if (!bodies.getForcesOnFluid()) return 0;
    placeSites();
    bodies.getForcesOnFluid()->getModel().follow(flow, placementOfSites, velocitiesOfSites);
    return velocitiesOfSites.col(0).dot(forcesOfSites.col(0));
}

void BodyFlow::addActiveSlips(MatrixXd& ofParticles) {
    for (size_t e = 0; e < bodies.getElements().size(); e++) {
        const vector<Vector3d>& slips = bodies.getElements()[e].slips;
        const int first = bodies.getMotion().firstParticleRow(e);
        for (size_t i = 0; i < slips.size(); i++)
            ofParticles.col(0).segment<3>(first + 3 * i) -= mobility.getTurns()[e] * slips[i];
    }
    if (!bodies.getForcesOnFluid()) return;
    placeSites();
    sites->multiply(forcesOfSites, velocitiesOfSites);
    mobility.costs.products += bodies.hasProducts();
    ofParticles += velocitiesOfSites.topRows(ofParticles.rows());
}

void BodyFlow::activeSlips(MatrixXd& slips) {
    const bool ofBodies = slipSpace.areOfBodies() && !bodies.getMotion().isIdentity();
    MatrixXd& ofParticles = ofBodies ? slipsOfFlow : slips;
    ofParticles.setZero(bodies.getNumParticleRows(), 1);
    addActiveSlips(ofParticles);
    if (ofBodies) mobility.forceFreeTwists(nullptr, ofParticles, slips);
    keepSpins([&](int e) { return bodies.spinOfSlips(e); }, slips);
}

void BodyFlow::twistsOf(const DrivenFlow& flow, MatrixXd& twists) {
    if (slipSpace.slipsAreTwists()) {
        slipsOf(flow, twists);
        return;
    }
    slipsOf(flow, slipsOfFlow);
    noWrenches.setZero(bodies.getNumRows(), 1);
    mobility.solve(noWrenches, slipsOfFlow, twists);
}

void BodyFlow::forcesOfTwists(const MatrixXd& twists, const DrivenFlow* flow, MatrixXd& forces) {
    MatrixXd relative = twists, slips;
    if (slipSpace.areOfBodies()) {
        if (flow) {
            slipsOf(*flow, slips);
            relative -= slips;
        }
        forces = mobility.friction() * relative;
        return;
    }
    mobility.rigidSlips(mobility.getPoses(), twists, relative);
    if (flow) {
        slipsOf(*flow, slips);
        relative -= slips;
    }
    mobility.forcesOfSlips(relative, forces);
}

FlowSources BodyFlow::sourcesOf(const MatrixXd& forces, const DrivenFlow* flow, bool active,
                                const Accuracy& accuracy) {
    BodiesAt& here = mobility.particlesHere();
    if (!slipSpace.areOfBodies()) return here.particles().sources(forces, flow, accuracy);
    MatrixXd wrenches = forces, ofParticles, slips;
    bodies.getOwnTensors().wrenchesForModel(here.getTurns(), wrenches);
    if (bodies.getMotion().isIdentity()) return here.particles().sources(wrenches, flow, accuracy);
    slips.setZero(bodies.getNumParticleRows(), 1);
    if (flow) here.follow(*flow, slips);
    if (active) addActiveSlips(slips);
    mobility.particleForces(wrenches, slips, ofParticles);
    return here.particles().sources(ofParticles, flow, accuracy);
}

}  // namespace RigidHIPlugin
