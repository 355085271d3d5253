#include "mobility/DrivenFlow.h"

#include <cmath>

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Vector3d DrivenFlow::velocityAt(const Vector3d& x, const WaveFactors& factors) const {
    Vector3d v = velocity + gradient * x;
    if (waveVelocity != 0)
        v[forceAxis] += factors.s * waveVelocity * std::sin(k * x[waveAxis] + phase);
    return v;
}

Matrix3d DrivenFlow::gradientAt(const Vector3d& x, double t) const {
    Matrix3d G = gradient;
    if (waveVelocity != 0)
        G(forceAxis, waveAxis) += t * waveVelocity * k * std::cos(k * x[waveAxis] + phase);
    return G;
}

Vector3d DrivenFlow::angularVelocityAt(const Vector3d& x, const WaveFactors& factors) const {
    const Matrix3d G = gradientAt(x, factors.t);
    return 0.5 * Vector3d(G(2, 1) - G(1, 2), G(0, 2) - G(2, 0), G(1, 0) - G(0, 1));
}

Matrix3d DrivenFlow::strainRateAt(const Vector3d& x, const WaveFactors& factors) const {
    const Matrix3d G = gradientAt(x, factors.t);
    return 0.5 * (G + G.transpose());
}

}  // namespace RigidHIPlugin
