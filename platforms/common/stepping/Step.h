#ifndef RIGIDHI_STEP_H_
#define RIGIDHI_STEP_H_

#include "stepping/Forces.h"
#include "stepping/Rejections.h"
#include "stepping/StartOfStep.h"

namespace RigidHIPlugin {

/** What steps are made of. */
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
     * From the forces with which the scheme begins to new poses, positions and velocities.
     * @throws OpenMMException; then the caller puts everything back to the start
     */
    virtual void take() = 0;
};

}  // namespace RigidHIPlugin

#endif
