#include "rigid/BodiesAt.h"

#include "linearalgebra/Symmetrise.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

void BodiesAt::setPoses(const vector<Pose>& newPoses, bool nearby) {
    poses = newPoses;
    setTurns(poses, turns);
    mobilityIsKnown = frictionIsKnown = false;
    placement.box = bodies.getBox();
    bodies.getMotion().place(poses, turns, placement);
    nearbyPoses = nearby;
    if (nearby) {
        bodies.getModel().placeNear(place, placement);
        return;
    }
    bodies.getModel().place(place, placement);
    checkPlaces();
}

void BodiesAt::anchorTo(const BodiesAt& other) {
    if (bodies.getModel().isAnchored()) bodies.getModel().place(place, other.placement);
}

void BodiesAt::checkPlaces() {
    const double roomForRounding = 0.5;
    const HydrodynamicParticles& particles = bodies.getParticles();
    placesInFormulas.resize(particles.size());
    bool lifted = false;
    for (int i = 0; i < particles.size(); i++) {
        placesInFormulas[i] = bodies.getModel().placeInFormulas(i, placement.positions[i]);
        lifted = lifted || placesInFormulas[i] != placement.positions[i];
    }
    // Blobs of one body alone keep their distances, which are known.
    if (bodies.getElements().size() > 1 || lifted) coincidence.check(particles, placesInFormulas, roomForRounding);
}

/** xi = K^T M^-1 K, before own tensors. */
void BodiesAt::computeFriction() {
    if (bodies.getMotion().isIdentity()) {
        place->friction(xi);
        return;
    }
    bodies.getMotion().fill(turns, K);
    if (bodies.getModel().isMadeFromFriction()) {
        place->friction(M);
        xi.noalias() = K.transpose() * M * K;
    } else {
        place->dense(M);
        if (!factor.compute(M)) refuseIndefiniteMobility(bodies.getParticles().size());
        factor.solveL(K);
        xi.noalias() = K.transpose() * K;
    }
    symmetrise(xi);
}

void BodiesAt::follow(const DrivenFlow& flow, MatrixXd& slips) {
    bodies.getModel().follow(flow, placement, slips);
    place->addStressletsOf(flow, slips);
}

void BodiesAt::forceFreeTwists(const MatrixXd& slips, const NullTwists& nullTwists, MatrixXd& twists) {
    if (bodies.getMotion().isIdentity()) {
        twists = slips;
        return;
    }
    costs.matrices++;
    bodies.getMotion().fill(turns, K);
    if (bodies.getModel().isMadeFromFriction()) {
        place->friction(M);
        scratch.noalias() = K.transpose() * M * K;
        twists.noalias() = K.transpose() * (M * slips);
    } else {
        MatrixXd half = slips;
        place->dense(M);
        if (!factor.compute(M)) refuseIndefiniteMobility(bodies.getParticles().size());
        factor.solveL(K);
        factor.solveL(half);
        scratch.noalias() = K.transpose() * K;
        twists.noalias() = K.transpose() * half;
    }
    nullTwists.lift(turns, scratch);
    inverting.compute(scratch);
    if (inverting.info() != Success) refuseIndefiniteFriction(bodies.getElements().size());
    inverting.solveInPlace(twists);
    nullTwists.removeTurns(turns, twists);
}

const MatrixXd& BodiesAt::friction() {
    if (frictionIsKnown) return xi;
    costs.matrices++;
    computeFriction();
    bodies.getOwnTensors().friction(turns, xi);
    frictionIsKnown = true;
    return xi;
}

const MatrixXd& BodiesAt::mobility() {
    if (mobilityIsKnown) return N;
    if (bodies.getMotion().isIdentity()) {
        costs.matrices++;
        place->dense(N);
        bodies.getOwnTensors().mobility(turns, N);
    } else {
        scratch = friction();
        bodies.getNullTwists().lift(turns, scratch);
        inverting.compute(scratch);
        if (inverting.info() != Success) refuseIndefiniteFriction(bodies.getElements().size());
        N = inverting.solve(MatrixXd::Identity(bodies.getNumRows(), bodies.getNumRows()));
        bodies.getNullTwists().project(turns, N);
        symmetrise(N);
    }
    mobilityIsKnown = true;
    return N;
}

}  // namespace RigidHIPlugin
