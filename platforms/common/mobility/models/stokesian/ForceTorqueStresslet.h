#ifndef RIGIDHI_FORCE_TORQUE_STRESSLET_H_
#define RIGIDHI_FORCE_TORQUE_STRESSLET_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <vector>

namespace RigidHIPlugin {

/**
 * The stresslets that keep spheres rigid under strain rates E of a driven flow, and under forces
 * and torques F: E + (C F + G S)/(8 pi eta) = 0. E and S are in the basis of StressletBasis.h, with
 * five rows for each sphere.
 */
struct StressletResponse {
    Eigen::MatrixXd factor;        // L, the Cholesky factor of G, lower triangle
    Eigen::MatrixXd halfCoupling;  // L^-1 C

    /**
     * Add the velocities and angular velocities induced by the stresslets of E: -C^T G^-1 E.
     *
     * @param strainRates  undefined afterwards
     */
    void addVelocities(Eigen::VectorXd& strainRates, Eigen::Ref<Eigen::VectorXd> velocities) const;
    /** S = -G^-1 (C F + 8 pi eta E). */
    Eigen::VectorXd stresslets(const Eigen::VectorXd& forces, const Eigen::VectorXd& strainRates,
                               double viscosity) const;
};

/**
 * Mobility of rigid spheres, each with a surface traction of a uniform force, a torque and a
 * stresslet ("FTS").
 *
 * Equation:  (U, Omega, E) = M (F, T, S), solved for the stresslets S that keep every sphere rigid,
 *            E = 0.
 * Accuracy:  The relative error of a pair's R is of order (a/r)^6, without lubrication. Blocks of
 *            force and torque are those of Rotne-Prager-Yamakawa.
 * Cost:      A Cholesky factorisation of 5 n stresslet rows: about 150 n^3 multiplications. Memory:
 *            (11 n)^2 numbers.
 * Reference: Durlofsky, Brady and Bossis, J. Fluid Mech. 180:21 (1987); Faxén operators as in Kim
 *            and Karrila (1991), ch. 3, with both spheres' a²/6 (force) and a²/10 (strain) terms
 *            kept. This is Galerkin's method on the single-layer equation. So, for spheres that do
 *            not overlap, M is positive definite, and the friction never exceeds the exact one.
 * Limits:    An overlapping pair has the functions of contact along its line of centres, which is
 *            no physical model of an overlap.
 *
 * Nothing is allocated if the matrices already have the right sizes.
 *
 * @param viscosity  dalton/(nm ps)
 * @param response  filled
 * @param mobility  6n x 6n, rows Vx Vy Vz Wx Wy Wz of each sphere about its centre, lab frame
 */
void computeForceTorqueStressletMobility(const std::vector<double>& radii,
                                         const std::vector<OpenMM::Vec3>& positions,
                                         double viscosity, StressletResponse& response,
                                         Eigen::MatrixXd& mobility);
/**
 * Likewise, in new memory.
 *
 * @param response  filled if not null
 */
Eigen::MatrixXd forceTorqueStressletMobility(const std::vector<double>& radii,
                                             const std::vector<OpenMM::Vec3>& positions,
                                             double viscosity,
                                             StressletResponse* response = nullptr);

}  // namespace RigidHIPlugin

#endif
