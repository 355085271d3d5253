#ifndef RIGIDHI_FRICTION_FACTOR_H_
#define RIGIDHI_FRICTION_FACTOR_H_

#include <Eigen/Core>
#include <vector>

#include "linearalgebra/CholeskyFactor.h"
#include "rigid/CoupledBodies.h"

namespace RigidHIPlugin {

/**
 * The Cholesky factor of the friction xi of all bodies, Z^T xi Z = L L^T, with free components
 * first (FreeMotion). The leading block of L is the factor of the friction of free components,
 * which gives the mobility N_c. All of L gives random wrenches of covariance xi: their free
 * components are the noise of the motion, and their fixed components the noise of the wrenches that
 * hold bodies. Null twists of collinear bodies are lifted, and removed from results (NullTwists).
 */
class FrictionFactor {
public:
    explicit FrictionFactor(const CoupledBodies& bodies) : bodies(bodies) {}
    /**
     * @param friction  its lower triangle is read; its contents are undefined afterwards
     * @return whether the friction is positive definite
     */
    bool compute(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& friction);
    /** wrenches -> N_c wrenches, at the turns of the friction. */
    void solve(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& x);
    /** wrenches -> N wrenches, as if all components were free. */
    void solveOfAll(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& x);
    /**
     * A wrench with the covariance xi.
     *
     * @param W  independent standard normal numbers, with the rows of bodies
     */
    void thermalWrench(const std::vector<Eigen::Matrix3d>& turns, const Eigen::MatrixXd& W,
                       Eigen::MatrixXd& wrench);

private:
    const CoupledBodies& bodies;
    CholeskyFactor factor;
};

}  // namespace RigidHIPlugin

#endif
