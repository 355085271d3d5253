#ifndef RIGIDHI_MID_STEP_TEMPERATURES_H_
#define RIGIDHI_MID_STEP_TEMPERATURES_H_

#include <map>
#include <string>

#include "host/MidStep.h"

namespace RigidHIPlugin {

class Scene;

/**
 * Temperatures, K, from mid-step energies: "translational", "rotational", "free", "total", as far
 * as these have degrees of freedom. The degrees of freedom that a CMMotionRemover takes are divided
 * between bodies and free particles by their masses, as is the kinetic energy of their common
 * motion.
 */
std::map<std::string, double> midStepTemperatures(const Scene& scene,
                                                  const MidStepEnergies& energies);

}  // namespace RigidHIPlugin

#endif
