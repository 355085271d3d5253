#ifndef RIGIDHI_DRAWN_VELOCITIES_H_
#define RIGIDHI_DRAWN_VELOCITIES_H_

#include <vector>

#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

class Scene;

/**
 * setVelocitiesToTemperature(): OpenMM asks for velocities of particles, and then sets them.
 * Velocities of particles do not determine the spin of one-site or linear bodies, so this class
 * keeps the drawn twists until then.
 */
class DrawnVelocities {
public:
    /**
     * Draw twists of bodies and velocities of free particles. Held bodies and particles get 0.
     * @return velocities of all particles
     */
    std::vector<OpenMM::Vec3> draw(Scene& scene, double temperature, int seed);
    /**
     * Velocities have been set. If they are the drawn ones, give the bodies the drawn twists.
     * @return whether they are
     */
    bool takeIn(Scene& scene);

private:
    // Empty unless draw() was the last change of velocities.
    std::vector<BodyState> twists;
    std::vector<OpenMM::Vec3> velocities;
};

}  // namespace RigidHIPlugin

#endif
