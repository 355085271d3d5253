#ifndef RIGIDHI_RESUMING_H_
#define RIGIDHI_RESUMING_H_

#include "context/SavedState.h"

namespace RigidHIPlugin {

class ContextMirror;
class Scene;

/** What makes a resumed run the same as the uninterrupted one, from the scene of a Context. */
SavedState collectState(Scene& scene, ContextMirror& mirror);

/**
 * What is saved goes on, bit for bit where a body's definition is the saved one. The System wins
 * for bodies that were added by their particles: what it now says of their masses and constraints
 * holds, and pose and twist are fitted to the saved positions and velocities. If anything is
 * refused, everything stays as it was.
 */
void adoptState(const SavedState& saved, Scene& scene, ContextMirror& mirror);

/** Likewise of the integrator's parameters in a State; a State without any is left alone. */
void adoptState(const OpenMM::SerializationNode& node, Scene& scene, ContextMirror& mirror);

/** Where the Context's positions are those of a saved state, its poses must be theirs: else it was
 * damaged or edited. */
void checkPosesAgainstPositions(const Scene& scene, const SavedState& saved);

}  // namespace RigidHIPlugin

#endif
