#ifndef RIGIDHI_FORCE_TORQUE_STRESSLET_H_
#define RIGIDHI_FORCE_TORQUE_STRESSLET_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <vector>

namespace RigidHIPlugin {

/**
 * The stresslets that keep spheres rigid under strain rates E of a driven flow, and under forces
 * and torques F: E + (C F + G S)/(8 pi eta) = 0. All are in the basis of StressletBasis.h, with
 * five rows a sphere.
 */
struct StressletResponse {
    Eigen::MatrixXd factor;        // L, the Cholesky factor of G, lower triangle
    Eigen::MatrixXd halfCoupling;  // L^-1 C

    /**
     * Add the velocities and angular velocities that the stresslets of E cause: -C^T G^-1 E.
     *
     * @param strainRates  has no meaning afterwards
     */
    void addVelocities(Eigen::VectorXd& strainRates, Eigen::Ref<Eigen::VectorXd> velocities) const;
    /** S = -G^-1 (C F + 8 pi eta E). */
    Eigen::VectorXd stresslets(const Eigen::VectorXd& forces, const Eigen::VectorXd& strainRates,
                               double viscosity) const;
};

/**
 * Mobility of rigid spheres whose surface tractions are a uniform force, a torque and a stresslet
 * each ("FTS").
 *
 * Equation:  (U, Omega, E) = M (F, T, S), solved for the stresslets S that keep every sphere rigid,
 *            E = 0.
 * Accuracy:  The error of R is of order (a/r)^6 relative for a pair; there is no lubrication.
 *            Blocks of force and torque are those of Rotne-Prager-Yamakawa.
 * Cost:      5 n stresslet rows by a Cholesky factorisation: about 150 n^3 multiplications. Memory:
 *            11 n rows squared.
 * Reference: Durlofsky, Brady and Bossis, J. Fluid Mech. 180:21 (1987); Faxén operators as in Kim
 *            and Karrila (1991), ch. 3, with both spheres' a²/6 (force) and a²/10 (strain) terms
 *            kept. This is Galerkin's method on the single-layer equation. So, for spheres that do
 *            not overlap, M is positive definite, and the friction never exceeds the exact one.
 * Limits:    Pairs closer than contact are taken at contact along their line, which is no physical
 *            model of an overlap.
 *
 * Nothing is allocated where the matrices have their sizes already.
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
 * @param response  filled, where not null
 */
Eigen::MatrixXd forceTorqueStressletMobility(const std::vector<double>& radii,
                                             const std::vector<OpenMM::Vec3>& positions,
                                             double viscosity,
                                             StressletResponse* response = nullptr);

}  // namespace RigidHIPlugin

#endif
