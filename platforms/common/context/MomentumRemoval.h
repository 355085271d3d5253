#ifndef RIGIDHI_MOMENTUM_REMOVAL_H_
#define RIGIDHI_MOMENTUM_REMOVAL_H_

#include <openmm/Vec3.h>

#include <vector>

namespace RigidHIPlugin {

class ContextMirror;
class Scene;

/**
 * A CMMotionRemover in a System whose masses do not make the bodies, or on a platform that does not
 * remove momentum exactly.
 *
 * OpenMM's remover computes the momentum of the particles with the System's masses, and shifts the
 * velocities of particles with mass. That is right for bodies that these masses make. For other
 * bodies the momentum would be a different one, and a shift of only some members would turn the
 * body. Where there are such bodies, the remover's work is undone, and repeated with the masses of
 * the bodies. The same is done on device platforms, which remove at every step whatever the
 * frequency, and add momenta up in single precision.
 */
class MomentumRemoval {
public:
    MomentumRemoval(Scene& scene, ContextMirror& mirror) : scene(scene), mirror(mirror) {}
    /** Whether a CMMotionRemover acts at the next step whose result would be wrong. */
    bool isToBeUndone() const;
    /** Whether a removal is due, which this class does if OpenMM's is to be undone. */
    bool isDue() const;
    /** Remember velocities, before OpenMM's remover acts. */
    void begin();
    /**
     * Give particles the remembered velocities, after OpenMM's remover, if it alone has changed
     * them since.
     */
    void undo();
    /**
     * Shift all velocities by the same amount, so that the momentum of bodies and free particles is
     * 0. Rotation stays as it is.
     */
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
