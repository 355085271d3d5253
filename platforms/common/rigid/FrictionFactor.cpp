#include "rigid/FrictionFactor.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

bool FrictionFactor::compute(const vector<Matrix3d>& turns, MatrixXd& friction) {
    const FreeMotion& free = bodies.getFreeMotion();
    bodies.getNullTwistsOfFree().lift(turns, friction);
    if (free.any()) free.order(turns, friction);
    return factor.compute(friction);
}

void FrictionFactor::solve(const vector<Matrix3d>& turns, MatrixXd& x) {
    const FreeMotion& free = bodies.getFreeMotion();
    if (!free.any()) {
        solveOfAll(turns, x);
        return;
    }
    bodies.getNullTwistsOfFree().removeTorques(turns, x);
    free.toOrdered(turns, x);
    if (free.getNumFree() > 0) factor.solveLeading(x.topRows(free.getNumFree()));
    x.bottomRows(free.getNumRows() - free.getNumFree()).setZero();
    free.fromOrdered(turns, x);
    bodies.getNullTwistsOfFree().removeTurns(turns, x);
}

void FrictionFactor::solveOfAll(const vector<Matrix3d>& turns, MatrixXd& x) {
    const FreeMotion& free = bodies.getFreeMotion();
    bodies.getNullTwistsOfFree().removeTorques(turns, x);
    if (free.any()) free.toOrdered(turns, x);
    factor.solve(x);
    if (free.any()) free.fromOrdered(turns, x);
    bodies.getNullTwistsOfFree().removeTurns(turns, x);
}

void FrictionFactor::thermalWrench(const vector<Matrix3d>& turns, const MatrixXd& W,
                                   MatrixXd& wrench) {
    const FreeMotion& free = bodies.getFreeMotion();
    wrench.noalias() = factor.L() * W;
    if (free.any()) free.fromOrdered(turns, wrench);
    bodies.getNullTwistsOfFree().removeLift(turns, wrench);
}

}  // namespace RigidHIPlugin
