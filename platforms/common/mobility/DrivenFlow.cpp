#include "mobility/DrivenFlow.h"

#include <cmath>

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/** Written with exponentials of distances from the planes, which do not overflow at any height. */
DrivenFlow::Profile DrivenFlow::profileAt(double z) const {
    if (!hasPlanes) return {};
    const double scale = 1 / (1 + std::exp(-k * (top - low))),
                 fromLow = scale * std::exp(-k * (z - low)),
                 fromTop = scale * std::exp(-k * (top - z));
    return {fromLow + fromTop, k * (fromTop - fromLow)};
}

Vector3d DrivenFlow::velocityAt(const Vector3d& x, const WaveFactors& factors) const {
    Vector3d v = velocity + gradient * x;
    if (!slope.isZero(0)) v += (x[2] - low) * slope;
    if (!bend.isZero(0)) v += ((x[2] - low) * (top - x[2]) - 2 * factors.laplacian) * bend;
    if (waveVelocity != 0)
        v[forceAxis] +=
            (factors.s - profileAt(x[2]).p) * waveVelocity * std::sin(k * x[waveAxis] + phase);
    return v;
}

Matrix3d DrivenFlow::gradientAt(const Vector3d& x, double t) const {
    Matrix3d G = gradient;
    if (!slope.isZero(0)) G.col(2) += slope;
    if (!bend.isZero(0)) G.col(2) += ((top - x[2]) - (x[2] - low)) * bend;
    if (waveVelocity != 0) {
        const Profile profile = profileAt(x[2]);
        const double angle = k * x[waveAxis] + phase;
        G(forceAxis, waveAxis) += (t - profile.p) * waveVelocity * k * std::cos(angle);
        if (hasPlanes) G(forceAxis, 2) -= profile.slope * waveVelocity * std::sin(angle);
    }
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

Vector3d DrivenFlow::mean() const {
    if (!hasPlanes) return Vector3d::Zero();
    const double height = high - low, width = top - low;
    Vector3d sum = 0.5 * height * slope;
    if (!bend.isZero(0)) sum += (0.5 * height * width - height * height / 3) * bend;
    return sum;
}

double DrivenFlow::meanOfWave() const {
    if (!hasPlanes) return 1;
    const double height = high - low;
    return 1 - (profileAt(high).slope - profileAt(low).slope) / (k * k * height);
}

}  // namespace RigidHIPlugin
