#include "rigid/ConstantMobility.h"

#include <Eigen/Geometry>

#include "linearalgebra/Decompositions.h"
#include "linearalgebra/Symmetrise.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

OwnTensors::Matrix6d turned(const OwnTensors::Matrix6d& tensor_body, const Matrix3d& A) {
    const OwnTensors::Matrix6d turn = twoRotations(A);
    return turn * tensor_body * turn.transpose();
}

}  // namespace

ConstantMobility::ConstantMobility(const CoupledBodies& bodies)
    : BodyMobility(bodies), isFixed(bodies.getFreeMotion().any()), factor(bodies),
      particles(bodies, costs) {
    const MatrixXd& own = bodies.getElements()[0].ownMobility;
    if (own.size() > 0) {
        const SlowedSpin& spin = bodies.getElements()[0].spin;
        mobility_body = own;
        if (spin.isSlowed()) mobility_body = spin.slow(mobility_body);
        friction_body = inverseOf(mobility_body);
    } else {
        particles.setPoses({Pose()});
        mobility_body = particles.mobility();
        friction_body = particles.friction();
    }
    setPoses({Pose()});
    MatrixXd lifted = friction();
    bodies.getNullTwists().lift(turns, lifted);
    if (!factor_body.compute(lifted)) refuseIndefiniteFriction(1);
}

void ConstantMobility::setPoses(const vector<Pose>& newPoses, bool) {
    poses = newPoses;
    setTurns(poses, turns);
    isFactorised = false;
}

/** The factor of the friction at the poses set last. */
FrictionFactor& ConstantMobility::factorHere() {
    if (!isFactorised) {
        MatrixXd ofAll = friction();
        if (!factor.compute(turns, ofAll)) refuseIndefiniteFriction(1);
        isFactorised = true;
    }
    return factor;
}

BodiesAt& ConstantMobility::particlesHere() {
    particles.setPoses(poses);
    return particles;
}

const MatrixXd& ConstantMobility::mobility() {
    if (isFixed) {
        N.setIdentity(bodies.getNumRows(), bodies.getNumRows());
        factorHere().solve(turns, N);
        symmetrise(N);
    } else {
        N = turned(mobility_body, turns[0]);
    }
    return N;
}

const MatrixXd& ConstantMobility::friction() {
    xi = turned(friction_body, turns[0]);
    return xi;
}

void ConstantMobility::multiply(const MatrixXd& wrenches, MatrixXd& twists, const Accuracy&) {
    twists.noalias() = mobility() * wrenches;
}

void ConstantMobility::solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
    if (isFixed) {
        twists = wrenches;
        if (slips.size() > 0) twists.noalias() += friction() * slips;
        factorHere().solve(turns, twists);
        thermal = twists;
        if (slips.size() > 0) thermal -= slips;
        wrenchesOfSolve.noalias() = friction() * thermal;
        return;
    }
    multiply(wrenches, twists);
    wrenchesOfSolve = wrenches;
    if (slips.size() > 0) twists += slips;
}

/** The body's own tensor resists rotation about the line of the blobs; the blobs do not. */
const NullTwists& ConstantMobility::nullTwistsOfBlobs() {
    const FluidElement& element = bodies.getElements()[0];
    if (!lineOfBlobs.any() && element.ownMobility.size() > 0 && element.particles.size() > 1)
        lineOfBlobs.find(0, element.sites);
    return lineOfBlobs.any() ? lineOfBlobs : bodies.getNullTwists();
}

void ConstantMobility::particleForces(const MatrixXd& wrenches, const MatrixXd& slips,
                                      MatrixXd& forces) {
    particlesHere().particleForces(wrenches, slips, nullTwistsOfBlobs(), forces);
}

void ConstantMobility::forceFreeTwists(const DrivenFlow* flow, const MatrixXd& slips,
                                       MatrixXd& twists) {
    if (forceFree_body.size() == 0) {
        BodiesAt inBody(bodies, costs);
        inBody.setPoses({Pose()});
        inBody.forceFreeTwists(MatrixXd::Identity(slips.rows(), slips.rows()), nullTwistsOfBlobs(),
                               forceFree_body);
    }
    const Matrix3d& A = turns[0];
    slips_body.resize(slips.rows(), slips.cols());
    for (int row = 0; row < slips.rows(); row += 3)
        slips_body.middleRows<3>(row).noalias() = A.transpose() * slips.middleRows<3>(row);
    twist_body.noalias() = forceFree_body * slips_body;
    twists.noalias() = twoRotations(A) * twist_body;
    if (!flow || !lineOfBlobs.any()) return;
    // About this line the body therefore turns with the flow.
    const Matrix<double, 6, 1> n = twoRotations(A) * lineOfBlobs.inBody(0);
    twists.col(0) +=
        n.tail<3>().dot(flow->angularVelocityAt(poses[0].R, {})) / n.tail<3>().squaredNorm() * n;
}

void ConstantMobility::multiplyNearby(const vector<Pose>& there, const MatrixXd& forces,
                                      MatrixXd& slips) {
    N = turned(mobility_body, there[0].rotation());
    if (!isFixed) {
        slips.noalias() = N * forces;
        return;
    }
    // Choose the generalised inverse of the friction with twists that a rod in a plane can have.
    const NullTwists& nullTwists = bodies.getNullTwistsOfFree();
    setTurns(there, turnsThere);
    thermal = forces;
    nullTwists.removeWorkOfFixed(turnsThere, thermal);
    slips.noalias() = N * thermal;
    nullTwists.turnWithFixed(turnsThere, slips);
}

void ConstantMobility::thermalWrench(const MatrixXd& W, MatrixXd& wrench) {
    if (isFixed) {
        factorHere().thermalWrench(turns, W, wrench);
        return;
    }
    thermal.noalias() = factor_body.L() * W;
    wrench.noalias() = twoRotations(turns[0]) * thermal;
    bodies.getNullTwists().removeLift(turns, wrench);
}

void ConstantMobility::thermalSlip(const MatrixXd& W, MatrixXd& slips) {
    thermalWrench(W, wrenchesOfSolve);
    if (isFixed) {
        slips.noalias() = turned(mobility_body, turns[0]) * wrenchesOfSolve;
        bodies.getNullTwistsOfFree().turnWithFixed(turns, slips);  // as in multiplyNearby()
    } else {
        multiply(wrenchesOfSolve, slips);
    }
}

Vector3d ConstantMobility::uniformDivergence() const {
    Vector3d sum = Vector3d::Zero();
    const Matrix3d coupling = mobility_body.topRightCorner<3, 3>();
    for (int k = 0; k < 3; k++) sum += Vector3d::Unit(k).cross(Vector3d(coupling.col(k)));
    return turns[0] * sum;
}

}  // namespace RigidHIPlugin
