#ifndef RIGIDHI_ACTING_FORCES_H_
#define RIGIDHI_ACTING_FORCES_H_

#include <string>

namespace OpenMM {
class Force;
class System;
}  // namespace OpenMM

namespace RigidHIPlugin {

/**
 * The effects of Forces of a System when a step starts (ContextImpl::updateContextState()), apart
 * from the forces that they make later.
 */
struct ActingForces {
    explicit ActingForces(const OpenMM::System& system);
    bool removers = false;   // CMMotionRemovers, which change velocities
    bool barostats = false;  // OpenMM's, which read and change positions and the box
    /** The class of a Force of an unknown kind, which may do anything; empty: none. */
    std::string other;
};

/**
 * Whether a Force makes no forces on particles by their positions in the Context. Such are Forces
 * that only move particles or remove momentum, and this plugin's forces on bodies.
 */
bool feelsNoParticles(const OpenMM::Force& force);

}  // namespace RigidHIPlugin

#endif
