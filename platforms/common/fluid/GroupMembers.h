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
 * The elements of a group where the rest of a Context keeps them: bodies in slots of BodySet, free
 * particles in FreeParticles and the Context's arrays. Poses and forces are read from there and
 * poses written back, in the order of the group's elements.
 */
class GroupMembers {
public:
    explicit GroupMembers(const CoupledBodies& bodies) : bodies(bodies) {}
    const CoupledBodies& getBodies() const { return bodies; }
    /** Of each element: its place in FreeParticles, -1: a body. */
    std::vector<int> freeIndex;

    void readPoses(const BodySet& set, const std::vector<OpenMM::Vec3>& positions,
                   std::vector<Pose>& poses) const;
    /** The forces and torques last gathered, lab frame, at the present poses of the bodies. */
    void readForces(const BodySet& set, const FreeParticles& freeParticles,
                    Eigen::MatrixXd& forces) const;
    /**
     * Velocities and angular velocities, lab frame. Those of fixed components are the prescribed
     * ones, whatever the velocities are.
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
     * Write poses to bodies and free particles. Forces and torques (lab) stay those of the poses
     * where they were evaluated. @return whether the poses are finite
     */
    bool writePoses(const std::vector<Pose>& poses, BodySet& set,
                    std::vector<OpenMM::Vec3>& positions) const;

private:
    const CoupledBodies& bodies;
};

}  // namespace RigidHIPlugin

#endif
