#ifndef RIGIDHI_FORCES_BETWEEN_GROUPS_H_
#define RIGIDHI_FORCES_BETWEEN_GROUPS_H_

#include <string>

namespace RigidHIPlugin {

class Scene;

/**
 * A warning if bodies of different groups of MobilityForce::setGroups() act on each other by a
 * force, or nothing. Such bodies are replicas, each in a fluid of its own, but OpenMM knows
 * nothing of groups.
 *
 * Pairs count within the cut-off of a NonbondedForce or CustomNonbondedForce; without a cut-off
 * they count if their distance is less than four times the largest hydrodynamic radius. Bonds
 * count at any distance. Images of periodic forces do not count. The cost is about one loop over
 * near pairs, because the function looks at particles along the longest axis and returns at the
 * first pair.
 */
std::string forcesBetweenGroups(const Scene& scene);

}  // namespace RigidHIPlugin

#endif
