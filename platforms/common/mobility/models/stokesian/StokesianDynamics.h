#ifndef RIGIDHI_STOKESIAN_DYNAMICS_H_
#define RIGIDHI_STOKESIAN_DYNAMICS_H_

#include <memory>
#include <string>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "mobility/models/stokesian/TwoSphereResistance.h"

namespace RigidHIPlugin {

/**
 * @throws OpenMMException always: the matrix of so many spheres is not positive definite. The
 *     message says what to do.
 */
[[noreturn]] void refuseIndefiniteSpheres(int numSpheres);

/**
 * Rigid spheres in unbounded fluid: many-body far field of forces, torques and stresslets, and
 * exact pair lubrication.
 *
 * Equation:  F = R U with R = M_FTS^-1 + sum over pairs (R_exact - R_FTS of the pair); without
 *            lubrication R = M_FTS^-1.
 * Accuracy:  One sphere and two spheres are exact (1e-9). With more spheres, multipoles beyond the
 *            stresslet that are not pairwise are missing. Each pair's term is positive
 *            semidefinite, because FTS is Galerkin's approximation from below, so R is positive
 *            definite. Every pair has its term at every distance, so R is a smooth function of the
 *            positions.
 * Cost:      About 150 n^3 multiplications for M_FTS, 150 n^3 for its inverse, and 70 n^3 to
 *            factorise R for apply(); 0.5 us a pair. Construction: 0.1 s for each new ratio of
 *            radii.
 * Reference: Durlofsky, Brady and Bossis, J. Fluid Mech. 180:21 (1987); Davidchack et al. (2017),
 *            section 4.
 * Limits:    Spheres with torque, one in a body, with ratios of radii up to 10. No overlap, unless
 *            there is a minimum gap.
 *
 * Moving to a placement only looks for overlaps. Matrices are made when they are first asked for.
 */
class StokesianDynamics : public MobilityModel {
public:
    /**
     * @param minimumGap  in mean radii of a pair. Lubrication of a smaller gap, and of an overlap,
     *     is that of this gap, and the far field of an overlap is that of contact. 0: spheres that
     *     touch are an error.
     * @throws OpenMMException  for particles without torque, bodies of several particles, radii in
     *     too large a ratio, or a bad minimum gap
     */
    StokesianDynamics(const HydrodynamicParticles& particles, double viscosity, bool lubrication,
                      double minimumGap)
        : StokesianDynamics(particles, viscosity, lubrication, minimumGap, false,
                            traitsOf(lubrication)) {}

    std::string objection(const Placement& placement) const override;
    /**
     * Whether spheres touch or overlap while there is no minimum gap, and the first such pair (not
     * indices in the System). Cost: n²/2 distances.
     */
    bool overlaps(const std::vector<OpenMM::Vec3>& positions, int& i, int& j) const;

    bool hasLubrication() const { return lubrication; }
    /**
     * The stresslets under forces that do not include those of lubrication, in a driven flow (null:
     * none).
     */
    Eigen::VectorXd stressletsOf(const StressletResponse& response, const Eigen::MatrixXd& forces,
                                 const DrivenFlow* flow,
                                 const std::vector<OpenMM::Vec3>& positions) const;
    /** Strain rates at the spheres, five numbers each in the basis of StressletBasis.h. */
    void strainRates(const DrivenFlow& flow, const std::vector<OpenMM::Vec3>& positions,
                     Eigen::VectorXd& rates) const;
    /**
     * Add a pair's lubrication to the friction of all particles. For a sphere and its own image, i
     * = j, the parts of both are added up.
     *
     * @param toJ  from the centre of i to that of j, nm
     * @param weight  the factor by which the lubrication is multiplied
     */
    void addLubrication(const Eigen::Vector3d& toJ, int i, int j, double weight,
                        Eigen::MatrixXd& friction) const;

protected:
    /** @param selfPairs  whether spheres have lubrication with their own images */
    StokesianDynamics(const HydrodynamicParticles& particles, double viscosity, bool lubrication,
                      double minimumGap, bool selfPairs, const MobilityTraits& traits);
    /** The traits in unbounded fluid. */
    static MobilityTraits traitsOf(bool lubrication);
    /**
     * Why a pair at this distance is refused; empty if it is not.
     *
     * @param image  whether the second particle is an image of j
     */
    std::string objectionToPair(int i, int j, double distance, const char* image) const;
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    const bool lubrication;
    const double minimumGap;
    std::vector<int> kind;  // of each particle: index of its radius among the distinct radii
    std::vector<std::vector<std::shared_ptr<const TwoSphereResistance>>>
        tables;  // [kind of the larger][kind of the smaller]
};

}  // namespace RigidHIPlugin

#endif
