#include "rigid/LubricatedSolver.h"

#include <Eigen/QR>
#include <cmath>

#include "mobility/InnerErrors.h"
#include "mobility/MobilityAt.h"
#include "rigid/RigidMotion.h"
#include "rigidbody/EigenVec3.h"

using namespace std;
using Eigen::MatrixXd;

namespace RigidHIPlugin {

LubricatedSolver::LubricatedSolver(const RigidMotion& motion, MultiblobSolver& multiblobs)
    : motion(motion), multiblobs(multiblobs) {
    const auto& elements = motion.getElements();
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const bool hasForces =
            element.isWhollyFixed() || (!element.isSphere() && !element.isFree());
        (hasForces ? ofForces : ofVelocities)
            .push_back({motion.firstParticleRow(e), element.numParticleRows()});
        if (element.isSphere()) {
            if (!hasForces && !element.isWhollyFree())
                restricted.push_back({(int)e, motion.firstParticleRow(e), numSpheres});
            numSpheres++;
        }
        if (!hasForces) continue;
        numForceRows += element.numParticleRows();
        for (int k = 0; k < element.numRows(); k++) numFreeRows += !element.isFixed(k);
    }
}

void LubricatedSolver::clear(const vector<Rows>& rows, MatrixXd& x) {
    for (const Rows& own : rows) x.middleRows(own.first, own.count).setZero();
}

/** The free motions of spheres are the columns of K that belong to free components. */
void LubricatedSolver::setFree(NearFactor& factor, const vector<Eigen::Matrix3d>& turns) {
    free.assign(restricted.empty() ? 0 : numSpheres, NearFactor::Projector::Identity());
    for (const Restricted& own : restricted) {
        const FluidElement& element = motion.getElements()[own.element];
        const Eigen::Matrix3d& A = turns[own.element];
        const Eigen::Matrix3d axes =
            element.fixedInBody ? Eigen::Matrix3d(A * element.axes) : Eigen::Matrix3d::Identity();
        NearFactor::Projector K = NearFactor::Projector::Identity();
        K.topRightCorner<3, 3>() = -crossMatrix(A * element.sites[0]);
        const MatrixXd ofAxes = K * twoRotations(axes);
        MatrixXd columns(6, 0);
        for (int k = 0; k < 6; k++)
            if (!element.isFixed(k)) {
                columns.conservativeResize(Eigen::NoChange, columns.cols() + 1);
                columns.rightCols(1) = ofAxes.col(k);
            }
        const MatrixXd basis = Eigen::HouseholderQR<MatrixXd>(columns).householderQ() *
                               MatrixXd::Identity(6, columns.cols());
        free[own.sphere] = basis * basis.transpose();
    }
    factor.setFree(free);
}

void LubricatedSolver::split(NearFactor& factor, const MatrixXd& unknowns) {
    scaledForces = unknowns;
    clear(ofVelocities, scaledForces);
    multiblobs.ownRigid(scaledForces, rigid);
    scaledForces -= rigid;
    factor.fromScaled(unknowns, velocities);
    clear(ofForces, velocities);
    if (restricted.empty()) return;
    ofFixed.setZero(velocities.rows(), velocities.cols());
    for (const Restricted& own : restricted) {
        const MatrixXd both = velocities.middleRows<6>(own.row);
        velocities.middleRows<6>(own.row) = free[own.sphere] * both;
        ofFixed.middleRows<6>(own.row) = both - velocities.middleRows<6>(own.row);
    }
}

/** The forces of particles on the fluid that follow from unknowns, after split(). */
void LubricatedSolver::findForces(NearAndFar& parts) {
    multiblobs.forcesFromScaled(scaledForces, forces);
    near.setZero(forces.rows(), forces.cols());
    parts.addNear(velocities, -1, near);
    clear(ofForces, near);  // what holds spheres bears their lubrication
    forces += near;
    if (restricted.empty()) return;
    near.setZero();
    parts.factorOfFriction()->addOwn(ofFixed, near);
    for (const Restricted& own : restricted) {
        const MatrixXd ofNear = forces.middleRows<6>(own.row),
                       ofHolds = near.middleRows<6>(own.row);
        forces.middleRows<6>(own.row) = free[own.sphere] * (ofNear + ofHolds) - ofHolds;
    }
}

/**
 * What slips give to the unknowns: to multiblobs that do not feel others, forces and motion.
 */
void LubricatedSolver::toUnknowns(NearFactor& factor, const MatrixXd& slips, MatrixXd& unknowns) {
    factor.toScaled(slips, unknowns);
    multiblobs.scaledFromSlips(slips, scaled);
    multiblobs.ownRigid(scaled, ofBodies);
    scaled = 2 * ofBodies - scaled;
    for (const Rows& own : ofForces)
        unknowns.middleRows(own.first, own.count) = scaled.middleRows(own.first, own.count);
}

/** The norm of U that errors are at least relative to: scaleWithSlips(). */
double LubricatedSolver::leastScale(const MatrixXd& slips) {
    if (slips.size() == 0 || numForceRows == 0) return 0;
    const double ofRandom = 3;
    multiblobs.scaledFromSlips(slips, scaled);
    clear(ofVelocities, scaled);
    return ofRandom * scaled.colwise().norm().minCoeff() * sqrt(double(numFreeRows) / numForceRows);
}

void LubricatedSolver::solve(NearAndFar& parts, const vector<Eigen::Matrix3d>& turns,
                             const MatrixXd& wrenches, const MatrixXd& slips, double tolerance,
                             MatrixXd& twists) {
    NearFactor& factor = *parts.factorOfFriction();
    setFree(factor, turns);
    MobilityAt& far = parts.far();
    // For spheres and free particles these are K^-T F, for multiblobs the forces of each alone.
    multiblobs.ownForces(wrenches, scaled);
    multiblobs.forcesFromScaled(scaled, farForces);
    far.multiply(farForces, ofFar);
    numProducts = wrenches.cols();
    if (slips.size() > 0) ofFar += slips;
    toUnknowns(factor, ofFar, rightSide);
    const double least = leastScale(slips);
    const Gmres::ErrorBound errorBound = {
        InnerErrors::boundBySingularValues * tolerance, [&](const MatrixXd& unknowns) {
            split(factor, unknowns);
            return max(least, sqrt(rigid.squaredNorm() + factor.energyOf(velocities)));
        }};
    gmres.solve(
        [&](const MatrixXd& unknowns, MatrixXd& result) {
            split(factor, unknowns);
            findForces(parts);
            far.multiply(forces, ofFar);
            numProducts += unknowns.cols();
            ofFar = velocities - ofFar;
            toUnknowns(factor, ofFar, result);
            result += rigid;
        },
        rightSide, InnerErrors::residualsOfLubrication * tolerance, solution, &errorBound);
    numIterations = gmres.getNumIterations();
    split(factor, solution);
    findForces(parts);
    farForces += forces;
    multiblobs.scaledFromSlips(velocities, scaled);
    scaled += rigid;
    multiblobs.ownTwists(scaled, twists);
}

}  // namespace RigidHIPlugin
