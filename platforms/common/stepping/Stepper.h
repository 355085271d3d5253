#ifndef RIGIDHI_STEPPER_H_
#define RIGIDHI_STEPPER_H_

#include "context/MomentumRemoval.h"
#include "stepping/BrownianStep.h"
#include "stepping/FluidStep.h"
#include "stepping/PlainStep.h"

namespace RigidHIPlugin {

/** Takes the steps of one Context. */
class Stepper {
public:
    Stepper(OpenMM::ContextImpl& context, Scene& scene, ContextMirror& mirror);
    /**
     * Steps, each of them: others' changes are taken in -> forces -> scheme -> new poses, momenta,
     * particle positions and velocities. Or an exception, and bodies and particles as they were
     * before the scheme began.
     */
    void takeSteps(int number);
    /** Forces at the present poses and time, gathered for bodies and free particles. */
    void evaluateForces();

private:
    template <class Work>
    void withArrays(const Work& work);
    void takeStep();
    void takeInChanges();
    void advance();
    Step& kindOfStep();
    OpenMM::ContextImpl& context;
    Scene& scene;
    ContextMirror& mirror;
    MomentumRemoval momentum;
    Forces forces;
    StartOfStep start;
    Rejections rejections;
    PlainStep plain;
    FluidStep withFluid;
    BrownianStep overdamped;
};

}  // namespace RigidHIPlugin

#endif
