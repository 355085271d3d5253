#ifndef RIGIDHI_ENVELOPES_H_
#define RIGIDHI_ENVELOPES_H_

#include <cmath>

namespace RigidHIPlugin {

// The envelopes of force coupling: the normalised Gaussians exp(-r^2/(2 width^2)) over which it
// spreads the forces and torques of a particle and averages the flow. Their widths give a single
// sphere its Stokes mobilities (Lomholt, Maxey, J. Comput. Phys. 184, 381 (2003)).

/** Width of the force envelope of a sphere of this radius, nm. */
inline double forceEnvelopeWidth(double radius) { return radius / std::sqrt(M_PI); }
/** The radius of a sphere with a force envelope of this width. */
inline double radiusOfForceEnvelope(double width) { return width * std::sqrt(M_PI); }
/** Width of the torque envelope. */
inline double torqueEnvelopeWidth(double radius) { return radius / std::cbrt(6 * std::sqrt(M_PI)); }

}  // namespace RigidHIPlugin

#endif
