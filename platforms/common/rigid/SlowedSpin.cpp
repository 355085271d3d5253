#include "rigid/SlowedSpin.h"

#include <algorithm>
#include <cmath>

#include "linearalgebra/Decompositions.h"

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

SlowedSpin::Vector6d SlowedSpin::slowedScrew() const {
    Vector6d result = factor * screw;
    result.head<3>() += advance * axis;
    return result;
}

BodyRotation findRotation(const MatrixXd& mobility, double doubleEnergy, const SpinBounds& bounds) {
    const SelfAdjointEigenSolver<Matrix3d> solver(Matrix3d(mobility.bottomRightCorner<3, 3>()));
    BodyRotation result;
    result.fastest = solver.eigenvalues()[2];
    result.second = solver.eigenvalues()[1];
    const double v1 = doubleEnergy * result.fastest, v2 = doubleEnergy * result.second;
    const double target = max(bounds.target, bounds.ratio * v2);
    if (!(v1 > bounds.resolved && v1 > leastSpinRatio * v2 && v1 > target)) return result;
    SlowedSpin& spin = result.spin;
    spin.axis = solver.eigenvectors().col(2);
    spin.screw = mobility.rightCols<3>() * spin.axis / result.fastest;
    spin.advance = spin.axis.dot(spin.screw.head<3>());
    spin.screw.head<3>() -= spin.advance * spin.axis;
    spin.factor = sqrt(target / v1);
    return result;
}

}  // namespace RigidHIPlugin
