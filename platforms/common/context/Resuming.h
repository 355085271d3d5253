#ifndef RIGIDHI_RESUMING_H_
#define RIGIDHI_RESUMING_H_

#include "context/SavedState.h"

namespace RigidHIPlugin {

class ContextMirror;
class Scene;

/**
 * Collect from the scene of a Context the data that make a resumed run the same as the
 * uninterrupted one.
 */
SavedState collectState(Scene& scene, ContextMirror& mirror);

/**
 * Go on from a saved state, bit for bit where a body's definition is the saved one. For bodies that
 * were added by their particles the System takes precedence: its present masses and constraints
 * count, and pose and twist are fitted to the saved positions and velocities. @throws
 * OpenMMException for a state that does not fit; everything then stays as it was
 */
void adoptState(const SavedState& saved, Scene& scene, ContextMirror& mirror);

/**
 * Go on from the integrator's parameters in a State. Does nothing for a State without parameters.
 */
void adoptState(const OpenMM::SerializationNode& node, Scene& scene, ContextMirror& mirror);

/**
 * Check a saved state whose positions are those of the Context: its poses must match them. If they
 * do not, the state was damaged or edited.
 */
void checkPosesAgainstPositions(const Scene& scene, const SavedState& saved);

}  // namespace RigidHIPlugin

#endif
