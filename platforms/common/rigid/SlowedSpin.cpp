#include "rigid/SlowedSpin.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

SlowedSpin::Matrix6d SlowedSpin::congruence() const {
    Matrix6d B = Matrix6d::Identity();
    B.rightCols<3>() -= (1 - factor) * screw * axis.transpose();
    return B;
}

SlowedSpin::Matrix6d SlowedSpin::slow(const Matrix6d& mobility) const {
    const Matrix6d B = congruence();
    return B * mobility * B.transpose();
}

BodyRotation findRotation(const MatrixXd& mobility, double doubleEnergy) {
    const SelfAdjointEigenSolver<Matrix3d> solver(Matrix3d(mobility.bottomRightCorner<3, 3>()));
    BodyRotation result;
    result.fastest = solver.eigenvalues()[2];
    result.second = solver.eigenvalues()[1];
    const double spin = doubleEnergy * result.fastest;
    const double bound = max(resolvedSpin, leastSpinRatio * doubleEnergy * result.second);
    if (!(spin > bound)) return result;
    result.spin.axis = solver.eigenvectors().col(2);
    result.spin.screw = mobility.rightCols<3>() * result.spin.axis / result.fastest;
    result.spin.factor = sqrt(bound / spin);
    return result;
}

}  // namespace RigidHIPlugin
