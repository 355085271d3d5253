#ifndef RIGIDHI_EFFECTS_H_
#define RIGIDHI_EFFECTS_H_

#include <map>
#include <string>

namespace RigidHIPlugin {

class Scene;

/** getEffects(): the effects that are on or off in a scene on a platform, and why. */
std::map<std::string, std::string> findEffects(const Scene& scene, const std::string& platform);

/**
 * Degrees of freedom of schemes with momenta, by kind; 0 for other schemes. The geometries of all
 * bodies must be known.
 */
std::map<std::string, int> countDegreesOfFreedom(const Scene& scene);

/** getStepStatistics(). */
std::map<std::string, double> nameCounters(const Scene& scene);

}  // namespace RigidHIPlugin

#endif
