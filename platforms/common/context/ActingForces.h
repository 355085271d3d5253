#ifndef RIGIDHI_ACTING_FORCES_H_
#define RIGIDHI_ACTING_FORCES_H_

namespace OpenMM {
class Force;
class System;
}  // namespace OpenMM

namespace RigidHIPlugin {

/** What Forces of a System do when a step starts (ContextImpl::updateContextState()), beside making
 * forces later. */
struct ActingForces {
    explicit ActingForces(const OpenMM::System& system);
    bool removers = false;   // CMMotionRemovers, which change velocities
    bool barostats = false;  // OpenMM's, which look at positions and change them, and the box
    bool others = false;     // that are not known, so may do anything
};

/** Whether a Force makes no forces on particles by their positions in the Context: what moves or
 * removes only, and ours on bodies. */
bool feelsNoParticles(const OpenMM::Force& force);

}  // namespace RigidHIPlugin

#endif
