#include "rigid/ParticleFactor.h"

#include "linearalgebra/SymmetricProduct.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

ParticleFactor::ParticleFactor(const CoupledBodies& bodies) : bodies(bodies) {
    const auto& elements = bodies.getElements();
    while (numHeld < (int)elements.size() && elements[numHeld].isHeld) {
        heldParticles += elements[numHeld].particles.size();
        heldRows += elements[numHeld].numParticleRows();
        heldBodyRows += elements[numHeld].numRows();
        numHeld++;
    }
}

bool ParticleFactor::heldAreKnown(const BodiesAt& at) const {
    if (heldPoses.empty() || heldBox != at.getPlacement().box) return false;
    for (int e = 0; e < numHeld; e++)
        if (!areSame(heldPoses[e], at.getPoses()[e])) return false;
    return true;
}

bool ParticleFactor::compute(BodiesAt& at) {
    if (!keepsHeld()) {
        at.particles().dense(matrix);
        return factor.compute(matrix);
    }
    if (heldAreKnown(at)) {
        at.particles().denseColumns(heldParticles, matrix);
    } else {
        heldPoses.clear();
        LKOfHeldIsKnown = false;
        at.particles().dense(matrix);
        if (!factor.computeLeading(matrix, heldRows)) return false;
        heldPoses.assign(at.getPoses().begin(), at.getPoses().begin() + numHeld);
        heldBox = at.getPlacement().box;
    }
    return factor.extend(matrix, heldRows);
}

void ParticleFactor::computeLKOfHeld(const vector<Matrix3d>& turns) {
    LKOfHeldIsKnown = true;
    bodies.getMotion().fill(turns, LK);
    K = LK.topLeftCorner(heldRows, heldBodyRows);
    factor.solveLeadingL(heldRows, K);
    LK.topLeftCorner(heldRows, heldBodyRows) = K;
    frictionOfHeld.setZero(heldBodyRows, heldBodyRows);
    addProductOfColumns(K, 1, frictionOfHeld);
}

void ParticleFactor::friction(const vector<Matrix3d>& turns, MatrixXd& xi) {
    xi.setZero(bodies.getNumRows(), bodies.getNumRows());
    if (!keepsHeld()) {
        bodies.getMotion().fill(turns, LK);
        factor.solveL(LK);
        xi.selfadjointView<Lower>().rankUpdate(LK.transpose());
        return;
    }
    if (!LKOfHeldIsKnown) computeLKOfHeld(turns);
    xi.topLeftCorner(heldBodyRows, heldBodyRows) = frictionOfHeld;
    const int others = LK.rows() - heldRows;
    if (others == 0) return;
    bodies.getMotion().fill(turns, K, numHeld);
    LK.bottomLeftCorner(others, heldBodyRows).setZero();
    LK.bottomRightCorner(others, K.cols()) = K;
    factor.continueL(heldRows, LK);
    xi.selfadjointView<Lower>().rankUpdate(LK.bottomRows(others).transpose());
}

}  // namespace RigidHIPlugin
