#ifndef RIGIDHI_PARTICLE_FACTOR_H_
#define RIGIDHI_PARTICLE_FACTOR_H_

#include <Eigen/Core>
#include <vector>

#include "linearalgebra/CholeskyFactor.h"
#include "rigid/BodiesAt.h"

namespace RigidHIPlugin {

/**
 * The Cholesky factor of the particles' mobility, M = L L^T, and the friction of the bodies, xi =
 * (L^-1 K)^T L^-1 K.
 *
 * Particles of held bodies come first. As long as they stay where they are, the parts that concern
 * them alone are computed only once: M_oo, its factor, (L^-1 K)_oo and their part of xi. A step
 * then computes the columns of M of the other particles, and extends the factor. With h held and m
 * other rows this takes h^2 m operations in place of (h + m)^3/3. Results have the same bits
 * whether or not these parts were known.
 */
class ParticleFactor {
public:
    explicit ParticleFactor(const CoupledBodies& bodies);
    /** Whether some parts are computed only once. */
    bool keepsHeld() const { return heldRows > 0; }
    /** @return whether M is positive definite */
    bool compute(BodiesAt& at);
    /** L */
    const CholeskyFactor& ofM() const { return factor; }
    /** xi, before own tensors, in the lower triangle; and L^-1 K. */
    void friction(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& xi);
    const Eigen::MatrixXd& getLK() const { return LK; }

private:
    bool heldAreKnown(const BodiesAt& at) const;
    void computeLKOfHeld(const std::vector<Eigen::Matrix3d>& turns);

    const CoupledBodies& bodies;
    int numHeld = 0, heldParticles = 0, heldRows = 0, heldBodyRows = 0;
    CholeskyFactor factor;
    Eigen::MatrixXd matrix, LK, K, frictionOfHeld;
    std::vector<Pose> heldPoses;  // empty: nothing is known
    BoxVectors heldBox = {};
    bool LKOfHeldIsKnown = false;
};

}  // namespace RigidHIPlugin

#endif
