#include "rigid/SlipSpace.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

SlipSpace::SlipSpace(const CoupledBodies& bodies)
    : bodies(bodies), ofBodies(bodies.slipsAreOfBodies()),
      ofParts(ofBodies && bodies.hasModel() && bodies.getModel().getTraits().slipsOfParts),
      identity(ofBodies || bodies.getMotion().isIdentity()) {
    nearest_body.resize(bodies.getElements().size());
    if (identity) return;
    for (size_t e = 0; e < nearest_body.size(); e++) {
        const MatrixXd K = bodies.getMotion().ofElement_body(e);
        nearest_body[e] =
            generalisedInverse(K.transpose() * K, bodies.getNullTwists().inBody(e)) * K.transpose();
    }
}

/** Fill the rows of parts with zeros. */
void SlipSpace::extend(MatrixXd& slips) const {
    const int rows = slips.rows();
    if (rows == getNumRows()) return;
    slips.conservativeResize(getNumRows(), slips.cols());
    slips.bottomRows(getNumRows() - rows).setZero();
}

void SlipSpace::add(const MatrixXd& slips, MatrixXd& sum) const {
    if (slips.rows() > sum.rows()) extend(sum);
    sum.topRows(slips.rows()) += slips;
}

void SlipSpace::rigidSlips(const vector<Pose>& poses, const MatrixXd& twists, MatrixXd& slips) {
    if (identity) {
        slips = twists;
        if (ofParts) extend(slips);
        return;
    }
    setTurns(poses, turns);
    bodies.getMotion().slips(turns, twists, slips);
}

void SlipSpace::totalWrenches(const vector<Pose>& poses, const MatrixXd& forces,
                              MatrixXd& wrenches) {
    if (identity) {
        wrenches = forces;
        return;
    }
    setTurns(poses, turns);
    bodies.getMotion().wrenches(turns, forces, wrenches);
}

void SlipSpace::nearestTwists(const vector<Matrix3d>& turnsHere, const MatrixXd& slips,
                              MatrixXd& twists) const {
    if (identity)
        twists = slips;
    else
        nearestTwistsOfParticles(turnsHere, slips, twists);
    bodies.getNullTwistsOfFree().turnWithFixed(turnsHere, twists);
}

void SlipSpace::nearestTwistsOfParticles(const vector<Matrix3d>& turnsHere, const MatrixXd& slips,
                                         MatrixXd& twists) const {
    twists.setZero(bodies.getNumRows(), slips.cols());
    for (size_t e = 0; e < nearest_body.size(); e++) {
        const MatrixXd& nearest = nearest_body[e];
        const Matrix3d& A = turnsHere[e];
        const int first = bodies.getMotion().firstParticleRow(e);
        for (int c = 0; c < slips.cols(); c++) {
            auto own = twists.col(c).segment(bodies.firstRow(e), bodies.getElements()[e].numRows());
            for (int r = 0; r < nearest.cols(); r += 3)
                own.noalias() +=
                    nearest.middleCols<3>(r) * (A.transpose() * slips.col(c).segment<3>(first + r));
            for (int r = 0; r < own.size(); r += 3)
                own.segment<3>(r) = (A * own.segment<3>(r)).eval();
        }
    }
}

}  // namespace RigidHIPlugin
