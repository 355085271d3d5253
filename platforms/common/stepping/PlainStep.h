#ifndef RIGIDHI_PLAIN_STEP_H_
#define RIGIDHI_PLAIN_STEP_H_

#include "stepping/Step.h"

namespace RigidHIPlugin {

/**
 * A step of bodies and free particles without coupling by the fluid: the thermostats, and
 * LangevinHI where the fluid couples nothing. One attempt is always enough.
 */
class PlainStep : public Step {
public:
    explicit PlainStep(const StepParts& parts) : parts(parts) {}
    void take() override;

protected:
    /**
     * Finish the step from the new poses: evaluate the forces there, and run the rest of the
     * scheme.
     */
    void finish();
    /** Do one part of a step for the free particles. */
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
