#ifndef RIGIDHI_DRIVEN_FLOW_H_
#define RIGIDHI_DRIVEN_FLOW_H_

#include <Eigen/Core>
#include <limits>

namespace RigidHIPlugin {

/**
 * How much of a wave a particle feels: s multiplies the velocity, and t multiplies the angular
 * velocity and the strain rate. Both are 1 for a wave much longer than the particle's radius. If
 * the velocity v is a quadratic polynomial, its average over the particle is
 * v + laplacian (nabla^2 v), where laplacian is -s''/2 at k = 0, in nm^2.
 */
struct WaveFactors {
    double s = 1, t = 1, laplacian = 0;
    /**
     * The widths of the particle's envelopes for the velocity, and for the angular velocity, nm; 0
     * for particles that do not reach through planes. Gaussians do: `gap` is then the distance from
     * the upper plane to the next image of the lower one (ConfinedForceCoupling).
     */
    double width = 0, torqueWidth = 0, gap = 0;
};

/**
 * A flow without particles:
 *     v(x) = velocity + gradient x + (z - low) (slope + bend (top - z))
 *            + waveVelocity sin(k x_b + phase) (1 - p(z)) e_a,   a != b.
 *
 * In a fluid with planes, the last two parts are 0 on the planes z = low and z = top. These planes
 * are both walls of a channel, or the wall of a film and its mirror image behind the free surface
 * z = high. Above a single wall `high` and `top` are infinite. In a fluid with planes, p(z) =
 * cosh(k (z - (low + top)/2)) / cosh(k (top - low)/2), which is exp(-k (z - low)) above a single
 * wall. Without planes p is 0.
 *
 * Envelopes that reach through a plane feel the flow beyond it: that of a fluid without forces
 * between the planes and their images, which moves with them, and is at rest behind a single wall.
 */
struct DrivenFlow {
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // nm/ps, at the origin of coordinates
    Eigen::Matrix3d gradient = Eigen::Matrix3d::Zero();  // dv_a/dx_b, 1/ps
    double waveVelocity = 0;                             // nm/ps
    int forceAxis = 0, waveAxis = 1;                     // a and b
    double k = 0, phase = 0;                             // 1/nm, radians
    bool hasPlanes = false;
    double low = 0, high = std::numeric_limits<double>::infinity(), top = high;  // nm
    Eigen::Vector3d slope = Eigen::Vector3d::Zero();  // 1/ps, along the planes
    Eigen::Vector3d bend = Eigen::Vector3d::Zero();   // 1/(nm ps), along the planes

    bool isZero() const {
        return velocity.isZero(0) && gradient.isZero(0) && waveVelocity == 0 && slope.isZero(0) &&
               bend.isZero(0);
    }
    bool hasGradient() const {
        return !gradient.isZero(0) || waveVelocity != 0 || !slope.isZero(0) || !bend.isZero(0);
    }
    /** The largest velocity gradient anywhere, 1/ps. */
    double largestGradient() const;
    /**
     * Averages over a particle: of v, of half the curl of v, and of the symmetric part of its
     * gradient. p(z) sin(k x_b + phase) is harmonic, so its average over a particle between the
     * planes is its value at the centre.
     */
    Eigen::Vector3d velocityAt(const Eigen::Vector3d& x, const WaveFactors& factors) const;
    Eigen::Vector3d angularVelocityAt(const Eigen::Vector3d& x, const WaveFactors& factors) const;
    Eigen::Matrix3d strainRateAt(const Eigen::Vector3d& x, const WaveFactors& factors) const;
    /** The velocity of the plane nearer to this z. Only the upper plane may move. */
    Eigen::Vector3d velocityOfNearerPlane(double z) const {
        if (slope.isZero(0) || z - low < top - z) return Eigen::Vector3d::Zero();
        return (top - low) * slope;
    }
    /**
     * Means over the height of the fluid, from z = low to z = high. mean() is the mean of the flow
     * along the planes that depends on z alone, and meanOfWave() is the mean of 1 - p. Without
     * planes they are 0 and 1.
     */
    Eigen::Vector3d mean() const;
    double meanOfWave() const;

private:
    Eigen::Matrix3d gradientAt(const Eigen::Vector3d& x, double t) const;
    Eigen::Matrix3d averageGradientAt(const Eigen::Vector3d& x, const WaveFactors& factors) const;
    /** p(z) and its derivative. */
    struct Profile {
        double p = 0, slope = 0;
    };
    Profile profileAt(double z) const;
    /**
     * Averages over an envelope, and their derivatives along z: of the flow that depends on z
     * alone, and of the factor of the wave.
     */
    struct Averages {
        Eigen::Vector3d steady = Eigen::Vector3d::Zero(), steadySlope = Eigen::Vector3d::Zero();
        double wave = 0, waveSlope = 0;
    };
    class Gaussian;
    bool mayReachThrough(double z, double width) const;
    Averages averagesAt(double z, double width, double gap) const;
    void addBetween(const Gaussian& envelope, Averages& sum) const;
    void addBeyond(const Gaussian& envelope, bool above, double gap, Averages& sum) const;
    Eigen::Vector3d steadyAt(double z) const;
    Eigen::Vector3d steadySlopeAt(double z) const;
};

}  // namespace RigidHIPlugin

#endif
