#ifndef RIGIDHI_FLUID_SETTINGS_H_
#define RIGIDHI_FLUID_SETTINGS_H_

#include <map>
#include <set>
#include <vector>

#include "forces/BodyMotions.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"

namespace RigidHIPlugin {

/** The integrator's settings that a fluid takes. A change that matters needs another fluid. */
struct FluidSettings {
    CustomRigidHIIntegrator::WallRejection wallRejection;
    CustomRigidHIIntegrator::Scheme scheme;
    std::set<int> heldBodies, heldParticles;  // setBodyHeld(), setParticleHeld()
    /** The components that CustomBodyMotions prescribe, by body; constant in a Context. */
    std::map<int, PrescribedComponents> prescribed;
    std::vector<JointDefinition> joints;
    /** The motors are constant in a Context; their rates may change. */
    std::vector<HingeMotorDefinition> motors;
    double jointTolerance, poseTolerance;

    FluidSettings(const CustomRigidHIIntegrator& integrator,
                  const std::map<int, PrescribedComponents>& prescribed,
                  const std::vector<JointDefinition>& joints,
                  const std::vector<HingeMotorDefinition>& motors)
        : wallRejection(integrator.getWallRejection()), scheme(integrator.getScheme()),
          prescribed(prescribed), joints(joints), motors(motors),
          jointTolerance(integrator.getJointTolerance()),
          poseTolerance(integrator.getPoseTolerance()) {
        for (int b = 0; b < integrator.getNumRigidBodies(); b++)
            if (integrator.getBodyHeld(b)) heldBodies.insert(b);
        for (int p : integrator.getHeldParticles()) heldParticles.insert(p);
    }
    /** Whether the same bodies and particles are held. */
    bool holdsAs(const FluidSettings& other) const {
        return heldBodies == other.heldBodies && heldParticles == other.heldParticles;
    }
    /** Whether joints, which are constant in a Context, have the same tolerances. */
    bool joinsAs(const FluidSettings& other) const {
        return joints.empty() ||
               (jointTolerance == other.jointTolerance && poseTolerance == other.poseTolerance);
    }
};

}  // namespace RigidHIPlugin

#endif
