#ifndef RIGIDHI_DRIVEN_FLOW_H_
#define RIGIDHI_DRIVEN_FLOW_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * How much of a wave a particle feels: the factor s of the velocity, and t of the angular velocity
 * and the strain rate. Both are 1 for a wave much longer than the particle's radius.
 */
struct WaveFactors {
    double s = 1, t = 1;
};

/** A flow without particles: v(x) = velocity + gradient x + waveVelocity sin(k x_b + phase) e_a,
 * with a != b. */
struct DrivenFlow {
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // nm/ps, at the origin of coordinates
    Eigen::Matrix3d gradient = Eigen::Matrix3d::Zero();  // dv_a/dx_b, 1/ps
    double waveVelocity = 0;                             // nm/ps
    int forceAxis = 0, waveAxis = 1;                     // a and b
    double k = 0, phase = 0;                             // 1/nm, radians

    bool isZero() const { return velocity.isZero(0) && gradient.isZero(0) && waveVelocity == 0; }
    bool hasGradient() const { return !gradient.isZero(0) || waveVelocity != 0; }
    /**
     * Averages over a particle: of v, of half the curl of v, and of the symmetric part of its
     * gradient.
     */
    Eigen::Vector3d velocityAt(const Eigen::Vector3d& x, const WaveFactors& factors) const;
    Eigen::Vector3d angularVelocityAt(const Eigen::Vector3d& x, const WaveFactors& factors) const;
    Eigen::Matrix3d strainRateAt(const Eigen::Vector3d& x, const WaveFactors& factors) const;

private:
    Eigen::Matrix3d gradientAt(const Eigen::Vector3d& x, double t) const;
};

}  // namespace RigidHIPlugin

#endif
