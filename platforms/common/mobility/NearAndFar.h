#ifndef RIGIDHI_NEAR_AND_FAR_H_
#define RIGIDHI_NEAR_AND_FAR_H_

#include <Eigen/Core>
#include <vector>

#include "random/CounterNoise.h"

namespace RigidHIPlugin {

class MobilityAt;
struct DrivenFlow;

/**
 * L, with L L^T near to D + Delta: D are the own frictions of particles, and Delta is that of
 * NearAndFar. L scales the velocities of iterations: y = L^T U is nearly as long as U in the norm
 * of the friction.
 */
class NearFactor {
public:
    virtual ~NearFactor() {}
    using Projector = Eigen::Matrix<double, 6, 6>;
    /**
     * Where only some motions of spheres are free, L L^T is near to P (D + Delta) P + (1 - P) D (1
     * - P). P is a matrix of 6 x 6 blocks, which project on the free motions of each sphere.
     *
     * @param free  one projector for each sphere, in the order of the particles; empty: P = 1
     */
    virtual void setFree(const std::vector<Projector>& free) = 0;
    /** forces += D velocities, in rows of spheres */
    virtual void addOwn(const Eigen::MatrixXd& velocities, Eigen::MatrixXd& forces) = 0;
    /** scaled = L^-1 D velocities, column by column */
    virtual void toScaled(const Eigen::MatrixXd& velocities, Eigen::MatrixXd& scaled) = 0;
    /** velocities = L^-T scaled */
    virtual void fromScaled(const Eigen::MatrixXd& scaled, Eigen::MatrixXd& velocities) = 0;
    /** The sum over columns of velocities^T (D + Delta) velocities. */
    virtual double energyOf(const Eigen::MatrixXd& velocities) = 0;
};

/**
 * A mobility N at a placement (MobilityAt::parts()) whose friction is the friction of another
 * mobility M plus a matrix Delta of near particles: N = (M^-1 + Delta)^-1 = (1 + M Delta)^-1 M.
 * Products with N need iterations; products with M and Delta do not.
 *
 * Noise:  the forces M^-1/2 W_1 + Delta^1/2 W_2 have the covariance N^-1.
 * Change: from a placement to a nearby one, the product N F changes by
 *         (1 + M Delta)^-1 (dM f - M dDelta U), with U = N F and f = F - Delta U.
 */
class NearAndFar {
public:
    virtual ~NearAndFar() {}
    /**
     * M. It may have more rows than N, for stresslets (MobilityTraits::slipsOfParts). Then
     * N = (B^T M^-1 B + Delta)^-1, where B is 0 in these rows.
     */
    virtual MobilityAt& far() = 0;
    /** forces += factor Delta velocities */
    virtual void addNear(const Eigen::MatrixXd& velocities, double factor,
                         Eigen::MatrixXd& forces) = 0;
    /**
     * forces += Delta^1/2 W_2, one column. The random numbers belong to a pair of particles (their
     * indices in the System) and an image, so they do not depend on the other pairs.
     *
     * @return the number of random numbers
     */
    virtual long long addNearNoise(const NoiseStream& noise, uint32_t purpose,
                                   Eigen::MatrixXd& forces) = 0;
    /**
     * velocities = (1 + M Delta)^-1 velocities, column by column, where M has the rows of N.
     *
     * @param tolerance  relative, in the norm of the friction
     */
    virtual void solve(double tolerance, Eigen::MatrixXd& velocities) = 0;
    /**
     * velocities = N (forces + B^T M^-1 slips), column by column. Slips and farForces have the rows
     * of far(); B selects the first of these rows, which are the rows of N.
     *
     * @param slips  without rows: none
     * @param farForces  M farForces + slips = B velocities
     */
    virtual void solve(double tolerance, const Eigen::MatrixXd& forces,
                       const Eigen::MatrixXd& slips, Eigen::MatrixXd& velocities,
                       Eigen::MatrixXd& farForces) = 0;
    /**
     * The effect of the strain of a flow on force-free spheres, as forces and slips: relative to
     * the flow, the spheres move with the velocities N (forces + B^T M^-1 slips).
     *
     * @return whether the mobility gives the effect in this form; if not,
     *     MobilityAt::addStressletsOf() gives the velocities. Default: false
     */
    virtual bool slipsOfStrain(const DrivenFlow& flow, Eigen::MatrixXd& forces,
                               Eigen::MatrixXd& slips) {
        return false;
    }
    /** The factor that scales iterations for scenes of spheres and multiblobs. Default: null */
    virtual NearFactor* factorOfFriction() { return nullptr; }
    /** Products with M in solves so far, and iterations. */
    virtual long long getNumProducts() const = 0;
    virtual long long getNumIterations() const = 0;
};

}  // namespace RigidHIPlugin

#endif
