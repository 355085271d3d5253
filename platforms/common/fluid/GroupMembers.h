#ifndef RIGIDHI_GROUP_MEMBERS_H_
#define RIGIDHI_GROUP_MEMBERS_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <vector>

#include "host/FreeParticles.h"
#include "rigid/CoupledBodies.h"
#include "rigidbody/BodySet.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/**
 * Connects the elements of a group with the places where the rest of a Context keeps them: slots of
 * BodySet for bodies, FreeParticles and the Context's arrays for free particles. This class reads
 * poses and forces from there, and writes poses back, in the order of the group's elements.
 */
class GroupMembers {
public:
    explicit GroupMembers(const CoupledBodies& bodies) : bodies(bodies) {}
    const CoupledBodies& getBodies() const { return bodies; }
    /** The place of each element in FreeParticles; -1 for a body. */
    std::vector<int> freeIndex;

    void readPoses(const BodySet& set, const std::vector<OpenMM::Vec3>& positions,
                   std::vector<Pose>& poses) const;
    /** The forces and torques last gathered, lab frame, at the present poses of the bodies. */
    void readForces(const BodySet& set, const FreeParticles& freeParticles,
                    Eigen::MatrixXd& forces) const;
    /**
     * Velocities and angular velocities, lab frame. Fixed components have the prescribed values,
     * whatever the velocities are.
     *
     * @param prescribed  as in readPrescribed()
     */
    void readTwists(const BodySet& set, const std::vector<OpenMM::Vec3>& velocities,
                    const Eigen::MatrixXd* prescribed, Eigen::MatrixXd& twists) const;
    /**
     * The prescribed velocities of fixed components (OverdampedMove::prescribe()).
     *
     * @param values  a column of 6 for each body of the Context; null: nothing is prescribed
     * @return whether something is prescribed for these elements
     */
    bool readPrescribed(const Eigen::MatrixXd* values, Eigen::MatrixXd& ofElements) const;
    /**
     * Write poses to bodies and free particles. Forces and torques (lab frame) remain those of the
     * poses where they were evaluated. @return whether the poses are finite
     */
    bool writePoses(const std::vector<Pose>& poses, BodySet& set,
                    std::vector<OpenMM::Vec3>& positions) const;

private:
    const CoupledBodies& bodies;
};

}  // namespace RigidHIPlugin

#endif
