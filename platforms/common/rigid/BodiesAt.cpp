#include "rigid/BodiesAt.h"

#include "linearalgebra/Symmetrise.h"
#include "mobility/StressletBasis.h"
#include "rigidbody/EigenVec3.h"

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
    if (bodies.getModel().getTraits().isAnchored) bodies.getModel().place(place, other.placement);
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
    if (bodies.getElements().size() > 1 || lifted)
        coincidence.check(particles, placesInFormulas, roomForRounding);
}

/** xi = K^T M^-1 K, before own tensors. */
void BodiesAt::computeFriction() {
    if (bodies.getMotion().isIdentity()) {
        place->friction(xi);
        return;
    }
    bodies.getMotion().fill(turns, K);
    if (bodies.getModel().getTraits().isMadeFromFriction) {
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

double BodiesAt::powerOn(const DrivenFlow& flow, const FlowSources& sources) const {
    const MobilityModel& model = bodies.getModel();
    MatrixXd velocities;
    model.follow(flow, placement, velocities);
    double power = velocities.col(0).dot(sources.forces.col(0));
    if (sources.stresslets.size() == 0) return power;
    const HydrodynamicParticles& particles = bodies.getParticles();
    for (int i = 0; i < particles.size(); i++)
        power += sources.stresslets.segment<5>(5 * i).dot(inStressletBasis(flow.strainRateAt(
            toEigen(placement.positions[i]), model.waveFactors(particles.radii[i], flow.k))));
    return power;
}

void BodiesAt::forceFreeTwists(const MatrixXd& slips, const NullTwists& nullTwists,
                               MatrixXd& twists) {
    if (bodies.getMotion().isIdentity()) {
        twists = slips;
        return;
    }
    noWrenches.setZero(bodies.getNumRows(), slips.cols());
    moveBodies(noWrenches, slips, nullTwists, twists, unusedForces);
}

void BodiesAt::particleForces(const MatrixXd& wrenches, const MatrixXd& slips,
                              const NullTwists& nullTwists, MatrixXd& forces) {
    MatrixXd twists;
    moveBodies(wrenches, slips, nullTwists, twists, forces);
}

void BodiesAt::moveBodies(const MatrixXd& wrenches, const MatrixXd& slips,
                          const NullTwists& nullTwists, MatrixXd& twists, MatrixXd& forces) {
    costs.matrices++;
    bodies.getMotion().fill(turns, K);
    if (bodies.getModel().getTraits().isMadeFromFriction) {
        place->friction(M);
        M_inverse_K.noalias() = M * K;
        M_inverse_slips.noalias() = M * slips;
    } else {
        place->dense(M);
        if (!factor.compute(M)) refuseIndefiniteMobility(bodies.getParticles().size());
        M_inverse_K = K;
        M_inverse_slips = slips;
        factor.solve(M_inverse_K);
        factor.solve(M_inverse_slips);
    }
    scratch.noalias() = K.transpose() * M_inverse_K;
    symmetrise(scratch);
    wrenchesOfSlips.noalias() = K.transpose() * M_inverse_slips;
    twists = wrenches + wrenchesOfSlips;
    nullTwists.removeTorques(turns, twists);
    nullTwists.lift(turns, scratch);
    inverting.compute(scratch);
    if (inverting.info() != Success) refuseIndefiniteFriction(bodies.getElements().size());
    inverting.solveInPlace(twists);
    nullTwists.removeTurns(turns, twists);
    forces.noalias() = M_inverse_K * twists;
    forces -= M_inverse_slips;
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
