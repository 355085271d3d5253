#ifndef RIGIDHI_PLAIN_STEP_H_
#define RIGIDHI_PLAIN_STEP_H_

#include "stepping/Step.h"

namespace RigidHIPlugin {

/** Bodies and free particles by themselves: the thermostats, and LangevinHI where the fluid couples
 * nothing. One attempt always does. */
class PlainStep : public Step {
public:
    explicit PlainStep(const StepParts& parts) : parts(parts) {}
    void take() override;

protected:
    /** New poses are there: the forces at their positions, and the rest of the scheme. */
    void finish();
    /** What free particles do is called in the same way in every part of a step. */
    template <class Part>
    LoopResult moveFree(Part part) {
        Scene& scene = parts.scene;
        return (*scene.freeParticles.*part)(scene.settings, *scene.loops, scene.arrays->positions(),
                                            scene.arrays->velocities(),
                                            scene.integrator.getConstraintTolerance());
    }
    void count(const LoopResult& result, const char* judged);
    StepParts parts;
};

}  // namespace RigidHIPlugin

#endif
