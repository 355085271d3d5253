#ifndef RIGIDHI_FLUID_ANSWERS_H_
#define RIGIDHI_FLUID_ANSWERS_H_

#include <Eigen/Core>
#include <vector>

#include "fluid/FlowReader.h"
#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

/** Answers to users about mobility and friction at the present poses, to the solver tolerance. */
class FluidAnswers {
public:
    explicit FluidAnswers(const FluidContents& fluid) : fluid(fluid) {}
    /** The matrices of n bodies, 6n x 6n, with force-free free particles. */
    Eigen::MatrixXd mobility(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    Eigen::MatrixXd friction(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    /** Twists of bodies from wrenches on them. @throws OpenMMException for a torque about a line of
     * blobs */
    Eigen::VectorXd apply(const Eigen::VectorXd& wrenches, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions);
    /** Velocities of all particles of the System, three rows each, from forces on them, without
     * rigidity. */
    Eigen::VectorXd applyToBlobs(const Eigen::VectorXd& forces, const BodySet& bodies,
                                 const std::vector<OpenMM::Vec3>& positions);

    // ---- Wrenches and forces that hold bodies and particles
    struct Holds {
        Eigen::VectorXd ofBodies;     // wrenches about the origin, six a body, lab frame
        Eigen::VectorXd ofParticles;  // forces, three a particle of the System
    };
    /** Whether the steps so far have left holds in every group that has fixed components. */
    bool knowsHoldsOfLastStep() const;
    /** The holds of the last step, with the shares of all its solves. */
    Holds holdsOfLastStep(int numParticles) const;
    /**
     * The holds without noise, under the forces last gathered, at the present poses and
     * (LangevinHI) the present velocities.
     */
    Holds holdsNow(const FlowQuestion& question) const;

    /** The force of each joint on its first body at the anchor in the last step, 3 x joints. */
    Eigen::MatrixXd jointForcesOfLastStep(int numJoints) const;
    /** The torque of each motor on its second body in the last step. */
    void motorTorquesOfLastStep(std::vector<double>& torques) const;

private:
    /** N, and N with joints, in a group. */
    Eigen::MatrixXd mobilityWithJoints(FluidGroup& group, BodyMobility& mobility) const;
    Holds noHolds(int numParticles) const;
    void scatterHolds(const FluidGroup& group, const Eigen::MatrixXd& from, Holds& to) const;
    BodyMobility& answering(FluidGroup& group, const BodySet& bodies,
                            const std::vector<OpenMM::Vec3>& positions) const;
    const FluidContents& fluid;
};

}  // namespace RigidHIPlugin

#endif
