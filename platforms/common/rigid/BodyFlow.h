#ifndef RIGIDHI_BODY_FLOW_H_
#define RIGIDHI_BODY_FLOW_H_

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "mobility/FlowSources.h"
#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

class BodyMobility;
class CoupledBodies;
class SlipSpace;

/**
 * The flow of the fluid around one group of bodies, at the poses that their BodyMobility has: what
 * a driven flow does to bodies, what active bodies do to the fluid, and the flow of forces.
 * BodyMobility::flow() gives this object.
 *
 * All slips have the form that SlipSpace says, one column. If slips belong to bodies, they are the
 * twists of force-free bodies.
 */
class BodyFlow {
public:
    using MatrixXd = Eigen::MatrixXd;

    explicit BodyFlow(BodyMobility& mobility);
    BodyFlow(const BodyFlow&) = delete;

    // ---- A driven flow
    /**
     * The slips of the flow, so that U = N (F + K^T M^-1 s). Bodies without hydrodynamic particles
     * follow the flow at their origin.
     */
    void slipsOf(const DrivenFlow& flow, MatrixXd& slips);
    /** The twists of force-free bodies in the flow. */
    void twistsOf(const DrivenFlow& flow, MatrixXd& twists);
    /**
     * The power of sources in a flow: forces times velocities of particles, torques times angular
     * velocities, stresslets times strain rates.
     */
    double powerOn(const DrivenFlow& flow, const FlowSources& sources);
    /** The power of the forces of bodies on the fluid in a flow. */
    double powerOfSites(const DrivenFlow& flow);

    // ---- Active bodies
    /**
     * The slips of active bodies: -A u, with the velocities u of setBodySlip(), and the flow of the
     * forces that bodies exert on the fluid.
     */
    void activeSlips(MatrixXd& slips);
    /** Add the wrenches that bodies take from their forces on the fluid. */
    void addActiveWrenches(MatrixXd& wrenches) const;

    // ---- The flow of forces
    /**
     * The forces that give bodies these twists in a driven flow (null: none). They are forces on
     * particles, or wrenches on bodies, as slips belong to particles or to bodies.
     */
    void forcesOfTwists(const MatrixXd& twists, const DrivenFlow* flow, MatrixXd& forces);
    /**
     * The sources of the fluid's flow of the solve with these BodyMobility::getBlobForces().
     *
     * @param flow    the driven flow, if the solve contained it; else null
     * @param active  whether the solve contained the slips of active bodies
     * @param accuracy  as in MobilityAt::sources()
     */
    FlowSources sourcesOf(const MatrixXd& forces, const DrivenFlow* flow, bool active,
                          const Accuracy& accuracy = Accuracy());
    /** MobilityAt::addFlowAt() */
    void addAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points, double factor,
               Velocities& velocities);
    /**
     * Add `factor` times the flow of the forces of bodies on the fluid to the velocities at points.
     */
    void addOfSitesAt(const std::vector<OpenMM::Vec3>& points, double factor,
                      Velocities& velocities);

private:
    void keepSpinOf(const DrivenFlow& flow, MatrixXd& slips);
    template <class Rate>
    void keepSpins(const Rate& rateOf, MatrixXd& slips);
    void addActiveSlips(MatrixXd& ofParticles);
    void placeSites();

    BodyMobility& mobility;
    const CoupledBodies& bodies;
    const SlipSpace& slipSpace;
    Placement placementOfSites;
    std::unique_ptr<MobilityAt> sites;  // the model with all particles, at the poses set last
    MatrixXd forcesOfSites, velocitiesOfSites;
    MatrixXd slipsOfFlow, noWrenches, spinsOfFlow, slipsOfSpins;
};

}  // namespace RigidHIPlugin

#endif
