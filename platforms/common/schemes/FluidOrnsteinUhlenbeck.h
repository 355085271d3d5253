#ifndef RIGIDHI_FLUID_ORNSTEIN_UHLENBECK_H_
#define RIGIDHI_FLUID_ORNSTEIN_UHLENBECK_H_

#include <Eigen/Core>

#include "linearalgebra/SymmetricEigen.h"

namespace RigidHIPlugin {

/**
 * The exact Ornstein-Uhlenbeck process of coupled momenta over a time h, at a constant symmetric S:
 *
 *   dZ = -S Z dt + sqrt(2 kT) S^(1/2) dW,
 *   Z(h) = exp(-S h) Z(0) + sqrt(kT) sqrt(1 - exp(-2 S h)) chi.
 *
 * Z = K^(1/2) (p, l) and S = K^(1/2) xi K^(1/2), where K are the inverse masses and moments. With
 * this scaling both matrices are symmetric functions of S, and one eigendecomposition serves both,
 * at any h S. This is Davidchack 2017, eq. 26, but without its matrix exponentials of non-symmetric
 * matrices and without its Cholesky factor of a nearly singular matrix.
 */
class FluidOrnsteinUhlenbeck {
public:
    /**
     * @param matrix  S, or its inverse, which is decomposed itself
     * @throws OpenMMException if it is not positive semidefinite
     */
    void decompose(const Eigen::MatrixXd& matrix, bool isInverse);
    /**
     * Z(0) becomes Z(h), without noise if kT is 0. Cost: two or three products of the eigenvectors
     * with a vector.
     */
    void step(double h, double kT, Eigen::VectorXd& Z, const Eigen::VectorXd& chi);
    /** The two matrices themselves: exp(-S h) - 1 and sqrt(1 - exp(-2 S h)). */
    void matrices(double h, Eigen::MatrixXd& decayMinusOne, Eigen::MatrixXd& noise);

private:
    SymmetricEigen eigen;
    Eigen::VectorXd rates;  // eigenvalues of S
    Eigen::VectorXd modes, noiseModes;
};

}  // namespace RigidHIPlugin

#endif
