#include "rigid/DenseMobility.h"

#include "linearalgebra/SymmetricProduct.h"
#include "linearalgebra/Symmetrise.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

DenseMobility::DenseMobility(const CoupledBodies& bodies)
    : BodyMobility(bodies), slipsAreTwists(getSlipSpace().slipsAreTwists()),
      isFixed(bodies.getFreeMotion().any()), here(bodies, costs), elsewhere(bodies, costs),
      particleFactor(bodies), M(particleFactor.ofM()), LK(particleFactor.getLK()), xi(bodies) {}

void DenseMobility::setPoses(const vector<Pose>& poses, bool nearby) {
    here.setPoses(poses, nearby);
    particlesAreFactorised = isFactorised = mobilityIsKnown = frictionIsKnown = false;
}

/**
 * Compute the Cholesky factor of the friction of bodies, in the lower triangle of `lifted`, lifted
 * along null twists.
 */
void DenseMobility::factoriseFriction() {
    if (!xi.compute(here.getTurns(), lifted)) refuseIndefiniteFriction(bodies.getElements().size());
    isFactorised = true;
}

void DenseMobility::factorise() {
    if (isFactorised) return;
    if (getSlipSpace().areOfBodies()) {
        lifted = here.friction();
        factoriseFriction();
        return;
    }
    factoriseParticles();
    if (slipsAreTwists) {
        isFactorised = true;
        return;
    }
    particleFactor.friction(here.getTurns(), lifted);
    factoriseFriction();
}

void DenseMobility::factoriseParticles() {
    if (particlesAreFactorised) return;
    costs.matrices++;
    if (!particleFactor.compute(here)) refuseIndefiniteMobility(bodies.getParticles().size());
    particlesAreFactorised = true;
}

const MatrixXd& DenseMobility::friction() {
    if (getSlipSpace().areOfBodies() || !particleFactor.keepsHeld()) return here.friction();
    if (frictionIsKnown) return frictionOfAll;
    factoriseParticles();
    particleFactor.friction(here.getTurns(), frictionOfAll);
    mirrorLower(frictionOfAll);
    frictionIsKnown = true;
    return frictionOfAll;
}

const MatrixXd& DenseMobility::mobility() {
    if (!isFixed) return here.mobility();
    if (mobilityIsKnown) return N;
    factorise();
    N.setIdentity(bodies.getNumRows(), bodies.getNumRows());
    xi.solve(here.getTurns(), N);
    symmetrise(N);
    mobilityIsKnown = true;
    return N;
}

void DenseMobility::multiply(const MatrixXd& wrenches, MatrixXd& twists, const Accuracy&) {
    twists.noalias() = mobility() * wrenches;
}

void DenseMobility::solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
    const bool withSlips = slips.size() > 0;
    numColumns = wrenches.cols();
    if ((int)columns.size() <= numColumns) columns.resize(numColumns + 1);
    MatrixXd &halfSlips = columns[numColumns].halfSlips,
             &halfForces = columns[numColumns].halfForces;
    factorise();
    if (isFixed && getSlipSpace().areOfBodies()) {
        twists = wrenches;
        if (withSlips) twists.noalias() += here.friction() * slips;
        xi.solve(here.getTurns(), twists);
        halfSlips = twists;
        if (withSlips) halfSlips -= slips;
        columns[numColumns].wrenches.noalias() = here.friction() * halfSlips;
        return;
    }
    if (!slipsAreTwists) {
        twists = wrenches;
        if (withSlips) {
            halfSlips = slips;
            M.solveL(halfSlips);
            twists.noalias() += LK.transpose() * halfSlips;
        }
        xi.solve(here.getTurns(), twists);
        halfForces.noalias() = LK * twists;  // L^T lambda
        if (withSlips) halfForces -= halfSlips;
        return;
    }
    if (getSlipSpace().areOfBodies()) {
        twists = wrenches;
        xi.solve(here.getTurns(), twists);
    } else {
        halfForces.noalias() = M.U() * wrenches;
        twists.noalias() = M.L() * halfForces;
    }
    columns[numColumns].wrenches = wrenches;
    if (withSlips) twists += slips;
}

void DenseMobility::getBlobForces(MatrixXd& lambda) {
    if (slipsAreTwists || getSlipSpace().areOfBodies()) {
        lambda = columns[numColumns].wrenches;
        return;
    }
    lambda = columns[numColumns].halfForces;
    M.solveU(lambda);
}

void DenseMobility::thermalWrench(const MatrixXd& W, MatrixXd& wrench) {
    costs.roots++;
    factorise();
    if (slipsAreTwists && !getSlipSpace().areOfBodies()) {
        wrench = W;
        M.solveU(wrench);
        return;
    }
    xi.thermalWrench(here.getTurns(), W, wrench);
}

void DenseMobility::thermalSlip(const MatrixXd& W, MatrixXd& slips) {
    if (getSlipSpace().areOfBodies()) {
        thermalWrench(W, thermal);
        slips = thermal;
        xi.solveOfAll(here.getTurns(), slips);
        return;
    }
    costs.roots++;
    factorise();
    slips.noalias() = M.L() * W;
}

void DenseMobility::forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) {
    if (getSlipSpace().areOfBodies()) {
        thermalWrench(W, forces);
        return;
    }
    factorise();
    forces = W;
    M.solveU(forces);
}

void DenseMobility::forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) {
    factorise();
    forces = slips;
    M.solve(forces);
}

void DenseMobility::multiplyNearby(const vector<Pose>& poses, const MatrixXd& forces,
                                   MatrixXd& slips) {
    elsewhere.anchorTo(here);
    elsewhere.setPoses(poses, true);
    if (getSlipSpace().areOfBodies()) {
        slips.noalias() = elsewhere.mobility() * forces;
        return;
    }
    elsewhere.particles().multiply(forces, slips);
    costs.products += forces.cols();
}

}  // namespace RigidHIPlugin
