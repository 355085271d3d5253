#ifndef RIGIDHI_STEP_H_
#define RIGIDHI_STEP_H_

#include "stepping/Forces.h"
#include "stepping/Rejections.h"
#include "stepping/StartOfStep.h"

namespace RigidHIPlugin {

/** The objects that steps work with. */
struct StepParts {
    Scene& scene;
    ContextMirror& mirror;
    Forces& forces;
    StartOfStep& start;
    Rejections& rejections;
};

/** One kind of step, with all its attempts. */
class Step {
public:
    virtual ~Step() {}
    /**
     * Go from the forces that the scheme begins with to new poses, positions and velocities.
     * @throws OpenMMException; the caller then restores the start of the step
     */
    virtual void take() = 0;
};

}  // namespace RigidHIPlugin

#endif
