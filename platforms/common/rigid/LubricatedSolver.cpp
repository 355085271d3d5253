#include "rigid/LubricatedSolver.h"

#include <cmath>

#include "mobility/InnerErrors.h"
#include "mobility/MobilityAt.h"
#include "rigid/RigidMotion.h"

using namespace std;
using Eigen::MatrixXd;

namespace RigidHIPlugin {

LubricatedSolver::LubricatedSolver(const RigidMotion& motion, MultiblobSolver& multiblobs)
    : multiblobs(multiblobs) {
    const auto& elements = motion.getElements();
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const bool hasForces =
            element.isWhollyFixed() || (!element.isSphere() && !element.isFree());
        (hasForces ? ofForces : ofVelocities)
            .push_back({motion.firstParticleRow(e), element.numParticleRows()});
        if (!hasForces) continue;
        numForceRows += element.numParticleRows();
        for (int k = 0; k < element.numRows(); k++) numFreeRows += !element.isFixed(k);
    }
}

void LubricatedSolver::clear(const vector<Rows>& rows, MatrixXd& x) {
    for (const Rows& own : rows) x.middleRows(own.first, own.count).setZero();
}

void LubricatedSolver::split(NearFactor& factor, const MatrixXd& unknowns) {
    scaledForces = unknowns;
    clear(ofVelocities, scaledForces);
    multiblobs.ownRigid(scaledForces, rigid);
    scaledForces -= rigid;
    factor.fromScaled(unknowns, velocities);
    clear(ofForces, velocities);
}

/** The forces of particles on the fluid that follow from unknowns, after split(). */
void LubricatedSolver::findForces(NearAndFar& parts) {
    multiblobs.forcesFromScaled(scaledForces, forces);
    near.setZero(forces.rows(), forces.cols());
    parts.addNear(velocities, -1, near);
    clear(ofForces, near);  // what holds spheres bears their lubrication
    forces += near;
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

void LubricatedSolver::solve(NearAndFar& parts, const MatrixXd& wrenches, const MatrixXd& slips,
                             double tolerance, MatrixXd& twists) {
    NearFactor& factor = *parts.factorOfFriction();
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
