#ifndef RIGIDHI_RELAXATION_H_
#define RIGIDHI_RELAXATION_H_

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "fluid/GroupMembers.h"
#include "fluid/MomentumScaling.h"
#include "host/PlatformLoops.h"
#include "linearalgebra/Lanczos.h"
#include "schemes/FluidOrnsteinUhlenbeck.h"

namespace RigidHIPlugin {

/** The fluid's part of a step of LangevinHI, and the objects that it changes. */
struct RelaxationStep {
    double h, kT;
    const NoiseStream& noise;
    BodySet& bodies;
    const FreeParticles& freeParticles;
    std::vector<OpenMM::Vec3>& velocities;
    PlatformLoops& loops;
    const DrivenFlow* flow;  // null: none
    /** Of the middle of the step, 6 for each body of the Context; null: nothing is prescribed. */
    const Eigen::MatrixXd* prescribed;
};

/**
 * The effect of the fluid on the momenta of one group in a step of LangevinHI (Davidchack 2017, eq.
 * 26): the exact Ornstein-Uhlenbeck process of Z at the present poses. In a driven flow, and beside
 * bodies whose motion is prescribed, the process is that of the momenta relative to those of
 * force-free bodies, which follow the fluid (about axes without moments bodies turn with the
 * fluid). Each strategy of BodyMobility has a class of its own, which makeRelaxation() makes.
 */
class Relaxation {
public:
    /** @param members  of the group */
    Relaxation(BodyMobility& mobility, const MomentumScaling& scaling, const GroupMembers& members)
        : mobility(mobility), scaling(scaling), members(members) {}
    virtual ~Relaxation() {}
    BodyMobility& getMobility() const { return mobility; }
    /** BodyMobility::describeProducts() of a step. Default: empty, without iterations. */
    virtual std::string describeProducts() const { return {}; }
    /**
     * Change momenta of bodies and velocities of free particles over the time h. @param poses  of
     * the elements
     */
    void relax(const std::vector<Pose>& poses, const RelaxationStep& step);
    /** Counts of the last step. */
    long long getNumRandomNumbers() const { return randomNumbers; }
    long long getNumIterations() const { return iterations; }
    int getNumRows() const { return scaling.getNumRows(); }
    bool isFinite() const { return Z.allFinite(); }
    /** The wrenches of the bodies on the fluid in the last step, times its length h. */
    void getImpulses(const RelaxationStep& step, Eigen::MatrixXd& impulses) const;

protected:
    /**
     * Called before a step uses the mobility, because others use it in between with tolerances of
     * their own.
     */
    virtual void prepare() {}
    /** Turn Z(0) into Z(h), with Z and chi of this step. */
    virtual void evolve(const RelaxationStep& step) = 0;

    BodyMobility& mobility;
    MomentumScaling scaling;
    Eigen::VectorXd Z, chi;
    long long iterations = 0;

private:
    void takeMomenta(const RelaxationStep& step);
    void giveMomenta(const RelaxationStep& step) const;
    bool takeMomentaOfFlow(const RelaxationStep& step);
    const GroupMembers& members;
    Eigen::VectorXd Z_start;
    Eigen::MatrixXd twists, Z_flow;  // of force-free bodies in the flow
    Eigen::MatrixXd prescribed, twistsOfFixed, noWrenches, slips, slipsOfFlow;
    std::vector<Eigen::Matrix3d> turns;
    long long randomNumbers = 0;
};

/**
 * Make the Relaxation for the strategy of this mobility.
 *
 * @param tolerance  of KrylovMobility, as the user has set it
 */
std::unique_ptr<Relaxation> makeRelaxation(BodyMobility& mobility, const MomentumScaling& scaling,
                                           const GroupMembers& members, double tolerance);

}  // namespace RigidHIPlugin

#endif
