#ifndef RIGIDHI_MOMENTUM_REMOVAL_H_
#define RIGIDHI_MOMENTUM_REMOVAL_H_

#include <openmm/Vec3.h>

#include <vector>

namespace RigidHIPlugin {

class ContextMirror;
class Scene;

/**
 * A CMMotionRemover beside bodies that the System's masses do not make, or on a platform that does
 * not remove exactly.
 *
 * OpenMM's remover takes the momentum of the particles by the System's masses, and shifts the
 * velocities of those with mass. That is right for bodies that these masses make. For others it
 * would be another momentum, and a shift of some members only would turn the body. So where there
 * are any the remover's work is undone, and done with the masses of the bodies. Likewise on device
 * platforms, which remove at every step whatever the frequency, and add momenta up in single
 * precision.
 */
class MomentumRemoval {
public:
    MomentumRemoval(Scene& scene, ContextMirror& mirror) : scene(scene), mirror(mirror) {}
    /** Whether a CMMotionRemover acts at the next step that would be wrong. */
    bool isToBeUndone() const;
    /** Whether one is due, whose work is ours if it is to be undone. */
    bool isDue() const;
    /** Before OpenMM's remover: remember velocities. */
    void begin();
    /** After it: give particles the velocities they had before, if it alone has changed them since.
     */
    void undo();
    /** Shift all velocities alike, so that the momentum of bodies and free particles is 0: rotation
     * stays as it is. */
    void remove();

private:
    Scene& scene;
    ContextMirror& mirror;
    std::vector<OpenMM::Vec3> before;
};

/** Whether the System's masses make all bodies. */
bool massesAreTheSystems(const Scene& scene);

}  // namespace RigidHIPlugin

#endif
