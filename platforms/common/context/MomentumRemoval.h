#ifndef RIGIDHI_MOMENTUM_REMOVAL_H_
#define RIGIDHI_MOMENTUM_REMOVAL_H_

#include <openmm/Vec3.h>

#include <vector>

namespace RigidHIPlugin {

class ContextMirror;
class Scene;

/**
 * Corrects a CMMotionRemover in a System whose masses are not those of the bodies, or on a platform
 * that does not remove momentum exactly.
 *
 * OpenMM's remover computes the momentum of the particles with the System's masses, and shifts the
 * velocities of particles with mass. This is right for bodies that get their masses from the
 * System. For other bodies the momentum would be a different one, and a shift of only some members
 * would turn the body. For such bodies, this class undoes the remover's work and repeats it with
 * the masses of the bodies. It does the same on device platforms, which remove momentum at every
 * step whatever the frequency, and sum momenta in single precision.
 */
class MomentumRemoval {
public:
    MomentumRemoval(Scene& scene, ContextMirror& mirror) : scene(scene), mirror(mirror) {}
    /**
     * Whether OpenMM's removal at the next step must be undone, because its result would be wrong.
     */
    bool isToBeUndone() const;
    /** Whether a removal is due at the next step, by the frequency of a CMMotionRemover. */
    bool isDue() const;
    /** Remember velocities, before OpenMM's remover acts. */
    void begin();
    /**
     * Give particles the remembered velocities, after OpenMM's remover, if only the remover has
     * changed velocities since begin().
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

/** Whether all bodies get their masses from the System. */
bool massesAreTheSystems(const Scene& scene);

}  // namespace RigidHIPlugin

#endif
