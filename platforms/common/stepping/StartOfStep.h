#ifndef RIGIDHI_START_OF_STEP_H_
#define RIGIDHI_START_OF_STEP_H_

#include "context/ContextMirror.h"

namespace RigidHIPlugin {

/** What a step began with, to which it goes back if it is redone or given up. */
class StartOfStep {
public:
    StartOfStep(Scene& scene, ContextMirror& mirror) : scene(scene), mirror(mirror) {}
    void save();
    /** Bodies, free particles and the fluid's memory go back, and the Context's particles with
     * them. */
    void putBack();
    /** Bodies and free particles only: to see what was there. */
    void show();
    const BodySet::Snapshot& bodies() const { return bodySnapshot; }
    const FreeParticles::Snapshot& freeParticles() const { return freeSnapshot; }

private:
    Scene& scene;
    ContextMirror& mirror;
    BodySet::Snapshot bodySnapshot;
    FreeParticles::Snapshot freeSnapshot;
};

}  // namespace RigidHIPlugin

#endif
