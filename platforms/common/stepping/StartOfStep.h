#ifndef RIGIDHI_START_OF_STEP_H_
#define RIGIDHI_START_OF_STEP_H_

#include "context/ContextMirror.h"

namespace RigidHIPlugin {

/** The state at the start of a step, to restore it if the step is redone or given up. */
class StartOfStep {
public:
    StartOfStep(Scene& scene, ContextMirror& mirror) : scene(scene), mirror(mirror) {}
    void save();
    /**
     * Restore bodies, free particles, the box and the fluid's memory, and also the Context's
     * particles.
     */
    void putBack();
    /** Restore bodies and free particles only, so that the start can be examined. */
    void show();
    const BoxVectors& getBox() const { return box; }
    const BodySet::Snapshot& bodies() const { return bodySnapshot; }
    const FreeParticles::Snapshot& freeParticles() const { return freeSnapshot; }

private:
    Scene& scene;
    ContextMirror& mirror;
    BoxVectors box = {};
    BodySet::Snapshot bodySnapshot;
    FreeParticles::Snapshot freeSnapshot;
};

}  // namespace RigidHIPlugin

#endif
