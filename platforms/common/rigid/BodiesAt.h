#ifndef RIGIDHI_BODIES_AT_H_
#define RIGIDHI_BODIES_AT_H_

#include <memory>
#include <vector>

#include "linearalgebra/CholeskyFactor.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/CoincidenceCheck.h"
#include "rigid/CoupledBodies.h"

namespace RigidHIPlugin {

/** Counts and times of computations, for getStepStatistics(). */
struct MobilityCosts {
    long long matrices = 0;      // dense mobilities and frictions; a constant one that turns is not
                                 // counted
    long long products = 0;      // with M
    long long iterations = 0;    // of solvers
    long long roots = 0;         // square roots; without the root of a constant tensor, which is
                                 // computed once
    double secondsOfSolver = 0;  // of Krylov methods with a grid, without its products

    void add(const MobilityCosts& other) {
        matrices += other.matrices;
        products += other.products;
        iterations += other.iterations;
        roots += other.roots;
        secondsOfSolver += other.secondsOfSolver;
    }
};

/**
 * Coupled bodies at one configuration: the particles' mobility there, and the matrices of the
 * bodies, made when first asked for. Several objects may exist at once. An object keeps results as
 * long as its poses, and its memory longer.
 */
class BodiesAt {
public:
    BodiesAt(const CoupledBodies& bodies, MobilityCosts& costs) : bodies(bodies), costs(costs) {}
    /**
     * Set one pose for each element; the rotation of a free particle is not used.
     *
     * @param nearby  the poses are a small displacement from accepted ones: near() of the model
     * @throws OpenMMException  as the model's at(), and for two particles of one radius at one
     *     place
     */
    void setPoses(const std::vector<Pose>& newPoses, bool nearby = false);
    const std::vector<Eigen::Matrix3d>& getTurns() const { return turns; }
    const Placement& getPlacement() const { return placement; }
    const std::vector<Pose>& getPoses() const { return poses; }
    /** Whether the poses were set as nearby ones. */
    bool isNearby() const { return nearbyPoses; }
    /**
     * Prepare this object for poses that are small displacements from those of `other`, and for
     * comparing results. If the model keeps data of an earlier placement
     * (MobilityTraits::isAnchored), bring it to the other's placement first.
     */
    void anchorTo(const BodiesAt& other);
    MobilityAt& particles() { return *place; }
    /** The slips of particles in a driven flow, with the effect of their stresslets. */
    void follow(const DrivenFlow& flow, Eigen::MatrixXd& slips);
    /** BodyMobility::powerOn() */
    double powerOn(const DrivenFlow& flow, const FlowSources& sources) const;
    /**
     * The twists of force-free bodies whose particles have these slips, (K^T M^-1 K)^-1 K^T M^-1 s,
     * by matrices. Own tensors have no effect.
     *
     * @param nullTwists  of the friction K^T M^-1 K
     */
    void forceFreeTwists(const Eigen::MatrixXd& slips, const NullTwists& nullTwists,
                         Eigen::MatrixXd& twists);
    /**
     * The forces of particles, M^-1 (K U - s), of bodies with these wrenches and slips (one column
     * each), U = (K^T M^-1 K)^-1 (F + K^T M^-1 s). Own tensors have no effect.
     */
    void particleForces(const Eigen::MatrixXd& wrenches, const Eigen::MatrixXd& slips,
                        const NullTwists& nullTwists, Eigen::MatrixXd& forces);
    /** Time of all products so far: MobilityAt::getSecondsOfGrid(). */
    double getSecondsOfGrid() const { return place ? place->getSecondsOfGrid() : 0; }
    /** N, computed when first asked for. */
    const Eigen::MatrixXd& mobility();
    /** The (pseudo-)inverse of N, computed when first asked for. */
    const Eigen::MatrixXd& friction();

private:
    void checkPlaces();
    void computeFriction();
    void moveBodies(const Eigen::MatrixXd& wrenches, const Eigen::MatrixXd& slips,
                    const NullTwists& nullTwists, Eigen::MatrixXd& twists, Eigen::MatrixXd& forces);

    const CoupledBodies& bodies;
    MobilityCosts& costs;
    std::vector<Eigen::Matrix3d> turns;
    Placement placement;
    std::vector<Pose> poses;
    bool nearbyPoses = false;
    std::unique_ptr<MobilityAt> place;  // made when first needed
    std::vector<OpenMM::Vec3> placesInFormulas;
    CoincidenceCheck coincidence;
    CholeskyFactor factor;                  // of M
    Eigen::LLT<Eigen::MatrixXd> inverting;  // factors of the friction
    Eigen::MatrixXd K, M, N, xi, scratch;
    Eigen::MatrixXd M_inverse_K, M_inverse_slips, wrenchesOfSlips, noWrenches, unusedForces;
    bool mobilityIsKnown = false, frictionIsKnown = false;
};

}  // namespace RigidHIPlugin

#endif
