#ifndef RIGIDHI_NEAR_AND_FAR_H_
#define RIGIDHI_NEAR_AND_FAR_H_

#include <Eigen/Core>

#include "random/CounterNoise.h"

namespace RigidHIPlugin {

class MobilityAt;
struct DrivenFlow;

/**
 * A mobility whose friction is the sum of that of another mobility M and of a matrix Delta of near
 * particles: N = (M^-1 + Delta)^-1 = (1 + M Delta)^-1 M, at a placement (MobilityAt::parts()).
 * Products with N are iterations, and those with M and Delta are not.
 *
 * Noise:  the forces M^-1/2 W_1 + Delta^1/2 W_2 have the covariance N^-1.
 * Change: from a place to one nearby, N changes by (1 + M Delta)^-1 (dM f - M dDelta U) when it
 *         multiplies forces F, with U = N F and f = F - Delta U.
 */
class NearAndFar {
public:
    virtual ~NearAndFar() {}
    /**
     * M. It may have more rows than N, which are those of stresslets
     * (MobilityTraits::slipsOfParts). Then N = (B^T M^-1 B + Delta)^-1, where B is 0 in these rows.
     */
    virtual MobilityAt& far() = 0;
    /** forces += factor Delta velocities */
    virtual void addNear(const Eigen::MatrixXd& velocities, double factor,
                         Eigen::MatrixXd& forces) = 0;
    /**
     * forces += Delta^1/2 W_2, one column. Numbers belong to a pair of particles (their indices in
     * the System) and an image, so that they do not depend on which other pairs there are.
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
     * velocities = N (forces + B^T M^-1 slips), column by column. Slips and the forces that M
     * multiplies have the rows of far(), the first of which are those of N, B.
     *
     * @param slips  without rows: none
     * @param farForces  M farForces + slips = B velocities
     */
    virtual void solve(double tolerance, const Eigen::MatrixXd& forces,
                       const Eigen::MatrixXd& slips, Eigen::MatrixXd& velocities,
                       Eigen::MatrixXd& farForces) = 0;
    /**
     * What the strain of a flow makes of spheres without forces: their velocities relative to those
     * of the flow are N (forces + B^T M^-1 slips).
     *
     * @return whether that is so; if not, MobilityAt::addStressletsOf() gives the velocities.
     *     Default: it is not
     */
    virtual bool slipsOfStrain(const DrivenFlow& flow, Eigen::MatrixXd& forces,
                               Eigen::MatrixXd& slips) {
        return false;
    }
    /** Products with M in solves so far, and iterations. */
    virtual long long getNumProducts() const = 0;
    virtual long long getNumIterations() const = 0;
};

}  // namespace RigidHIPlugin

#endif
