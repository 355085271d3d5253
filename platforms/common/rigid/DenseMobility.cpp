#include "rigid/DenseMobility.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

DenseMobility::DenseMobility(const CoupledBodies& bodies)
    : BodyMobility(bodies), slipsAreTwists(getSlipSpace().isIdentity()), here(bodies, costs),
      elsewhere(bodies, costs) {}

void DenseMobility::setPoses(const vector<Pose>& poses, bool nearby) {
    here.setPoses(poses, nearby);
    isFactorised = false;
}

/**
 * Compute the Cholesky factor of the friction of bodies, in the lower triangle of `lifted`, lifted
 * along null twists.
 */
void DenseMobility::factoriseFriction() {
    bodies.getNullTwists().lift(here.getTurns(), lifted);
    if (!xi.compute(lifted)) refuseIndefiniteFriction(bodies.getElements().size());
    isFactorised = true;
}

void DenseMobility::factorise() {
    if (isFactorised) return;
    if (getSlipSpace().areOfBodies()) {
        lifted = here.friction();
        factoriseFriction();
        return;
    }
    costs.matrices++;
    here.particles().dense(mobilityOfParticles);
    if (!M.compute(mobilityOfParticles)) refuseIndefiniteMobility(bodies.getParticles().size());
    if (slipsAreTwists) {
        isFactorised = true;
        return;
    }
    bodies.getMotion().fill(here.getTurns(), LK);
    M.solveL(LK);
    lifted.setZero(bodies.getNumRows(), bodies.getNumRows());
    lifted.selfadjointView<Lower>().rankUpdate(LK.transpose());
    factoriseFriction();
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
    if (!slipsAreTwists) {
        twists = wrenches;
        if (withSlips) {
            halfSlips = slips;
            M.solveL(halfSlips);
            twists.noalias() += LK.transpose() * halfSlips;
        }
        bodies.getNullTwists().removeTorques(here.getTurns(), twists);
        xi.solve(twists);
        bodies.getNullTwists().removeTurns(here.getTurns(), twists);
        halfForces.noalias() = LK * twists;  // L^T lambda
        if (withSlips) halfForces -= halfSlips;
        return;
    }
    if (getSlipSpace().areOfBodies()) {
        twists = wrenches;
        xi.solve(twists);
    } else {
        halfForces.noalias() = M.U() * wrenches;
        twists.noalias() = M.L() * halfForces;
    }
    columns[numColumns].wrenches = wrenches;
    if (withSlips) twists += slips;
}

void DenseMobility::getBlobForces(MatrixXd& lambda) {
    if (slipsAreTwists) {
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
    wrench.noalias() = xi.L() * W;
    bodies.getNullTwists().removeLift(here.getTurns(), wrench);
}

void DenseMobility::thermalSlip(const MatrixXd& W, MatrixXd& slips) {
    if (getSlipSpace().areOfBodies()) {
        thermalWrench(W, thermal);
        solve(thermal, slips);
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
