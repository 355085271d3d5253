#ifndef RIGIDHI_FLUID_ANSWERS_H_
#define RIGIDHI_FLUID_ANSWERS_H_

#include <Eigen/Core>
#include <vector>

#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

/** Answers to users about mobility and friction at the present poses, to their tolerance. */
class FluidAnswers {
public:
    explicit FluidAnswers(const FluidContents& fluid) : fluid(fluid) {}
    /** The matrices of bodies, 6n x 6n: free particles are force-free. */
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

private:
    BodyMobility& answering(FluidGroup& group, const BodySet& bodies,
                            const std::vector<OpenMM::Vec3>& positions) const;
    const FluidContents& fluid;
};

}  // namespace RigidHIPlugin

#endif
