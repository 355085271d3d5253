#ifndef RIGIDHI_FLUID_SETTINGS_H_
#define RIGIDHI_FLUID_SETTINGS_H_

#include <map>
#include <set>
#include <vector>

#include "forces/BodyMotions.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"

namespace RigidHIPlugin {

/** What a fluid takes from the integrator. Where these settings matter, it is made for them. */
struct FluidSettings {
    CustomRigidHIIntegrator::WallRejection wallRejection;
    CustomRigidHIIntegrator::Scheme scheme;
    std::set<int> heldBodies, heldParticles;  // setBodyHeld(), setParticleHeld()
    /** What CustomBodyMotions prescribe, by body, the same as long as the Context. */
    std::map<int, PrescribedComponents> prescribed;
    std::vector<JointDefinition> joints;
    /** Which motors there are is the same as long as the Context; their rates may change. */
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
    /** Whether joints, which are the same as long as the Context, have the same tolerances. */
    bool joinsAs(const FluidSettings& other) const {
        return joints.empty() ||
               (jointTolerance == other.jointTolerance && poseTolerance == other.poseTolerance);
    }
};

}  // namespace RigidHIPlugin

#endif
