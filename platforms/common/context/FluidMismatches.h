#ifndef RIGIDHI_FLUID_MISMATCHES_H_
#define RIGIDHI_FLUID_MISMATCHES_H_

#include <string>

#include "context/Warnings.h"

namespace RigidHIPlugin {

/**
 * Settings of a fluid and positions in it that do not fit each other. Each function returns a
 * warning, or nothing if they fit.
 */

/** Settings of the MobilityForce that the Context does not have. */
std::string fluidWithoutUpdate(const Scene& scene);
/** A setting of the MobilityForce that its model and boundary do not use. */
std::string settingWithoutEffect(const Scene& scene);
/**
 * Particles of two bodies at nearly the same place, which are one sphere for the fluid; or spheres
 * whose volumes are larger than the box. Both come from lengths in another unit.
 */
std::string coincidentParticles(const Scene& scene);
std::string overfullBox(const Scene& scene);
/** Single spheres close to a no-slip wall in a flow with a gradient, which they do not disturb. */
std::string spheresInFlowAtWall(const Scene& scene);
/** The last three, which depend on positions and look at every particle. */
void addMismatchesOfPlaces(const Scene& scene, Warnings& warnings);

}  // namespace RigidHIPlugin

#endif
