#ifndef RIGIDHI_STOKESIAN_DYNAMICS_H_
#define RIGIDHI_STOKESIAN_DYNAMICS_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/models/lubricated/LubricationReach.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "mobility/models/stokesian/TwoSphereResistance.h"

namespace RigidHIPlugin {

/**
 * @throws OpenMMException always, because the matrix of so many spheres is not positive definite.
 *     The message has a remedy.
 */
[[noreturn]] void refuseIndefiniteSpheres(int numSpheres);

/**
 * Rigid spheres in unbounded fluid: the many-body far field of forces, torques and stresslets, with
 * exact pair lubrication.
 *
 * Equation:  F = R U with R = M_FTS^-1 + Delta_FF and Delta = sum over pairs (R_exact - R_FTS of
 *            the pair); without lubrication Delta = 0. Delta has rows for forces, torques and
 *            stresslets. In a driven flow of velocities U' and strain rates E at the spheres, w = U
 *            - U': f + Delta_FF w = F + Delta_FE E, where w = M_FTS f - C^T G^-1 E, and the
 *            stresslets are -G^-1 (C f + 8 pi eta E) + Delta_SF w - Delta_SE E. In a wave,
 *            lubrication does not act on strain, and Delta_FF acts on w + C^T G^-1 E
 *            (relativeVelocities() in the source).
 * Accuracy:  One sphere and two spheres are exact (1e-9). With more spheres, the contributions of
 *            multipoles beyond the stresslet that are not pairwise are missing. Each pair's term is
 *            positive semidefinite, because FTS is Galerkin's approximation from below, so R is
 *            positive definite. Every pair has its term at every distance, so R is a smooth
 *            function of the positions.
 * Cost:      About 150 n^3 multiplications for M_FTS, 150 n^3 for its inverse, and 70 n^3 to
 *            factorise R for multiply(); 0.5 us for each pair. Construction: 0.1 s for each new
 *            ratio of radii.
 * Reference: Durlofsky, Brady and Bossis, J. Fluid Mech. 180:21 (1987); Davidchack et al. (2017),
 *            section 4.
 * Limits:    Spheres with torque, one in each body, with ratios of radii up to 10. No overlap
 *            without a minimum gap.
 *
 * A move to a placement only looks for overlaps. Matrices are made on first use.
 */
class StokesianDynamics : public MobilityModel {
public:
    /**
     * @param minimumGap  in mean radii of a pair. A smaller gap, or an overlap, has the lubrication
     *     of this gap, and an overlap has the far field of contact. 0: spheres that touch are an
     *     error.
     * @throws OpenMMException  for particles without torque, bodies of several particles, too large
     *     a ratio of radii, or an invalid minimum gap
     */
    StokesianDynamics(const HydrodynamicParticles& particles, double viscosity, bool lubrication,
                      double minimumGap, const LubricationReach& reach = everywhere)
        : StokesianDynamics(particles, viscosity, lubrication, minimumGap, false,
                            traitsOf(lubrication), reach) {}
    /** Lubrication of all pairs, because no distance is so large. */
    static constexpr LubricationReach everywhere = {1e100, 2e100};

    std::string objection(const Placement& placement) const override;
    /**
     * Whether spheres touch or overlap without a minimum gap, and the first such pair (not as
     * indices in the System). Cost: n²/2 distances.
     */
    bool overlaps(const std::vector<OpenMM::Vec3>& positions, int& i, int& j) const;

    bool hasLubrication() const { return lubrication; }
    const LubricationReach& getReach() const { return reach; }
    /** Strain rates at the spheres, five numbers each in the basis of StressletBasis.h. */
    void strainRates(const DrivenFlow& flow, const std::vector<OpenMM::Vec3>& positions,
                     Eigen::VectorXd& rates) const;
    /**
     * Add a pair's lubrication to the friction of all particles. For a sphere and its own image
     * (i = j) it adds the parts of both.
     *
     * @param toJ  from the centre of i to that of j, nm
     * @param weight  the factor of the lubrication
     */
    void addLubrication(const Eigen::Vector3d& toJ, int i, int j, double weight,
                        Eigen::MatrixXd& friction) const;
    /**
     * Add the forces, torques and stresslets of a pair's lubrication, for these velocities and
     * angular velocities of the spheres and these additional strain rates of their surfaces. Other
     * arguments are those of addLubrication().
     *
     * @param strains  five numbers for each sphere in the basis of StressletBasis.h, like
     *     stresslets
     */
    void addLubricationForces(const Eigen::Vector3d& toJ, int i, int j, double weight,
                              const Eigen::VectorXd& twists, const Eigen::VectorXd& strains,
                              Eigen::VectorXd& forces, Eigen::VectorXd& stresslets) const;

protected:
    /** @param selfPairs  whether spheres have lubrication with their own images */
    StokesianDynamics(const HydrodynamicParticles& particles, double viscosity, bool lubrication,
                      double minimumGap, bool selfPairs, const MobilityTraits& traits,
                      const LubricationReach& reach);
    /** The traits in unbounded fluid. */
    static MobilityTraits traitsOf(bool lubrication);
    /**
     * The reason why the model refuses a pair at this distance; empty if it accepts the pair.
     *
     * @param image  whether the second particle is an image of j
     */
    std::string objectionToPair(int i, int j, double distance, const char* image) const;
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    /** A pair in the order of the tables: sphere 0 is the larger one. */
    struct LubricatedPair {
        int particle[2];
        double radius[2];
        Eigen::Vector3d direction;  // from sphere 0 to 1
        double gap;                 // in mean radii, at least the minimum gap
        const TwoSphereResistance* table;
    };
    LubricatedPair lubricatedPair(const Eigen::Vector3d& toJ, int i, int j) const;

    const bool lubrication;
    const double minimumGap;
    const LubricationReach reach;
    std::vector<int> kind;  // the index of each particle's radius among the distinct radii
    std::vector<std::vector<std::shared_ptr<const TwoSphereResistance>>>
        tables;  // [kind of the larger][kind of the smaller]
};

/**
 * Spheres with stresslets at one placement: the common part of the models in unbounded fluid and in
 * a periodic box.
 */
class SpheresAt : public MobilityAt {
public:
    explicit SpheresAt(const StokesianDynamics& model) : MobilityAt(model), model(model) {}
    void addStressletsOf(const DrivenFlow& flow, Eigen::MatrixXd& slips) override;
    /** The sources have the given forces; their stresslets include those of lubrication. */
    FlowSources sources(const Eigen::MatrixXd& forces, const DrivenFlow* flow,
                        const Accuracy&) override;

protected:
    /** A pair's vector from i to j, i, j, and the weight of its lubrication. */
    using PairVisitor = std::function<void(const Eigen::Vector3d&, int, int, double)>;
    /** Visit all pairs that have lubrication. */
    virtual void visitPairs(const PairVisitor& visit) const = 0;
    /** The response of the far field's stresslets to forces and strains. */
    virtual const StressletResponse& farFieldResponse() = 0;

    const StokesianDynamics& model;
    std::vector<OpenMM::Vec3> positions;

private:
    /** Whether lubrication acts on the strain of this flow; false for a null pointer. */
    bool strainsPairs(const DrivenFlow* flow) const;
    /** The velocities of force-free spheres relative to a flow. */
    void relativeVelocities(const DrivenFlow& flow, Eigen::VectorXd& velocities);
    void lubricationForces(const Eigen::VectorXd& twists, const Eigen::VectorXd& strains,
                           Eigen::VectorXd& forces, Eigen::VectorXd& stresslets) const;

    Eigen::VectorXd rates, ofStrains, pairRates, pairForces, pairStresslets, relative;
    Eigen::MatrixXd column, answer;
};

}  // namespace RigidHIPlugin

#endif
