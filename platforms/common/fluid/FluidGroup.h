#ifndef RIGIDHI_FLUID_GROUP_H_
#define RIGIDHI_FLUID_GROUP_H_

#include <memory>
#include <string>
#include <vector>

#include "fluid/BodiesAlone.h"
#include "fluid/BrownianGroup.h"
#include "fluid/GroupMembers.h"
#include "fluid/MomentumHolds.h"
#include "fluid/Relaxation.h"
#include "mobility/GridChoice.h"
#include "rigid/BodyMobilities.h"
#include "schemes/OverdampedSchemes.h"

namespace RigidHIPlugin {

/**
 * Elements that feel each other: the bodies of a replica, or one body under FreeDraining. The group
 * has the best strategy for each of three purposes (GroupBuilder). The strategies may be the same.
 */
struct FluidGroup {
    FluidGroup(const std::vector<FluidElement>& elements,
               const CoupledBodies::ModelFactory& makeModel, double tolerance,
               std::shared_ptr<BodiesAlone::Shapes> shapes)
        : bodies(elements, makeModel), mobilities(bodies, tolerance), alone(bodies, shapes),
          poses(elements.size()) {}

    CoupledBodies bodies;
    BodyMobilities mobilities;
    GroupMembers members{bodies};
    BodiesAlone alone;
    bool hasNullVectors = false;
    bool isThermostat = false;  // a Thermostat does its tensor, LangevinHI has nothing to do
    double drag_t = 0, drag_r[3] = {0, 0, 0};  // if it is a thermostat
    std::unique_ptr<Joints> joints;            // null: none
    std::unique_ptr<Relaxation> relaxation;    // for LangevinHI; null if it is a thermostat
    std::unique_ptr<BrownianGroup> brownian;   // for schemes without momenta
    std::unique_ptr<MomentumHolds> holds;      // of LangevinHI; null: no component is fixed
    std::string objection;              // against the poses after the last stage without momenta
    BodyMobility* answering = nullptr;  // for requests of users
    /** Elements that are held or wholly prescribed, by themselves; null: none is prescribed. */
    std::unique_ptr<CoupledBodies> wholly;
    std::vector<Pose> poses;
    std::string gridChoice;  // how Auto chose between matrices and a grid; empty without a choice
    ColumnSeconds columns;   // not 0 where Auto takes such matrices, which lubrication needs
    bool dependsOnScheme = false;  // whether the choice depends on the scheme

    /** The box or the grid of the group's model; null if the model lacks it, or without a model. */
    const BoxOfModel* box() const { return bodies.hasModel() ? bodies.getModel().box() : nullptr; }
    const GridOfModel* grid() const {
        return bodies.hasModel() ? bodies.getModel().grid() : nullptr;
    }

    /** Read the poses of the elements into `poses`. */
    const std::vector<Pose>& readPoses(const BodySet& set,
                                       const std::vector<OpenMM::Vec3>& positions) {
        members.readPoses(set, positions, poses);
        return poses;
    }
    /** Why the model has no mobility at the present poses; empty if it has one. */
    std::string objectionTo(const BodySet& set, const std::vector<OpenMM::Vec3>& positions);
    /**
     * objectionTo() the held and wholly prescribed elements alone, whose poses no noise can change.
     */
    std::string objectionToWhollyFixed(const BodySet& set,
                                       const std::vector<OpenMM::Vec3>& positions) const;
    /**
     * Check that a wrench does not turn a body about the line of its collinear blobs, where neither
     * fluid nor inertia resists.
     * @param siteForces  the sum of the magnitudes of the forces that make up the wrench
     * @throws OpenMMException naming the body, for a torque beyond rounding
     */
    void checkTorque(int element, const Eigen::Matrix<double, 6, 1>& wrench_body,
                     double siteForces) const;
};

}  // namespace RigidHIPlugin

#endif
