#ifndef RIGIDHI_FLUID_CONTENTS_H_
#define RIGIDHI_FLUID_CONTENTS_H_

#include <openmm/System.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "fluid/FluidGroup.h"
#include "fluid/FluidSettings.h"
#include "fluid/UserFlow.h"
#include "host/FreeParticles.h"
#include "host/PlatformLoops.h"
#include "openmmrigidhi/ModelTraits.h"
#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/** "the periodic box (…) …, nm", for messages. */
std::string textOf(const BoxVectors& box);

/**
 * The contents of the fluid of one Context. The parts of Fluid and the reports share them.
 *
 * A group is a set of elements with a matrix of its own: the bodies of a replica, or one body under
 * FreeDraining. A body that is alone in a homogeneous fluid has a constant tensor in its own frame.
 */
struct FluidContents {
    /** The groups come from GroupBuilder. @throws OpenMMException as GroupBuilder does */
    FluidContents(const MobilityForce& force, const FluidSettings& settings,
                  const OpenMM::System& system,
                  const std::vector<std::vector<int>>& particlesOfBodies,
                  const std::vector<BodyGeometry>& geometries, const BodySet& bodies,
                  const FreeParticles& freeParticles, PlatformLoops& loops);
    FluidContents(const FluidContents&) = delete;

    const MobilityForce force;
    const UserFlow userFlow;
    const FluidSettings settings;
    PlatformLoops& loops;
    const std::vector<std::vector<int>> particlesOfBodies;
    const std::vector<std::unique_ptr<FluidGroup>> groups;
    std::vector<int> elementOfBody;             // in its group
    std::vector<int> groupOfBody, groupOfFree;  // free: by place in FreeParticles, -1: not seen
    BoxVectors box = {};                        // zeros: no box

    void setBox(const BoxVectors& box);
    /** The flow that users drive, in the box; null: none. */
    const DrivenFlow* getFlow() const { return isDriven ? &flow : nullptr; }
    bool isFreeDraining() const { return force.getModel() == MobilityForce::FreeDraining; }
    /** Whether setWallRejection() matters. */
    bool hasWalls() const { return traitsOf(force.getBoundary()).hasWalls(); }
    /** Whether the fluid has a periodic box. In other fluids nothing changes with the box. */
    bool isPeriodic() const { return !isFreeDraining() && force.usesPeriodicBoundaryConditions(); }
    /**
     * Whether a body that is alone in its group feels only the fluid around it: no wall, and no
     * images of its own.
     */
    bool isUniform() const { return isFreeDraining() || traitsOf(force.getBoundary()).isUniform(); }
    /**
     * Whether all bodies share one fluid, so that users can ask for its flow. Otherwise no data of
     * steps are kept.
     */
    bool hasOneFlow() const { return groups.size() == 1 && !isFreeDraining(); }
    /**
     * Whether users can ask for the flow of the last step, so that data of steps are kept. The
     * stages of a sheared step are in different boxes and cannot be repeated.
     */
    bool remembersSteps() const {
        return hasOneFlow() && !userFlow.isSheared() && !losesFlowOfNoise();
    }
    /**
     * Whether the flow due to noise is not known: slips of parts (MobilityTraits::slipsOfParts)
     * make stresslets that no share of forces has.
     */
    bool losesFlowOfNoise() const {
        return groups[0]->bodies.hasModel() &&
               groups[0]->bodies.getModel().getTraits().slipsOfParts;
    }
    /**
     * Find the wrenches that held fixed components in the last step, where steps leave this for
     * later.
     */
    void findHolds() const;
    /**
     * Call task(i) for i = 0 ... count - 1, each for a group, in threads where threads are faster.
     * @param operations  arithmetic operations of all tasks, roughly
     */
    void forGroups(int count, double operations, const std::function<void(int)>& task) const;

private:
    DrivenFlow flow;  // in the box
    bool isDriven = false;
};

}  // namespace RigidHIPlugin

#endif
