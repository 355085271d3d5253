#ifndef RIGIDHI_STEPPER_H_
#define RIGIDHI_STEPPER_H_

#include "context/MomentumRemoval.h"
#include "host/MidStep.h"
#include "stepping/BrownianStep.h"
#include "stepping/FluidStep.h"
#include "stepping/PlainStep.h"

namespace RigidHIPlugin {

/** Takes the steps of one Context. */
class Stepper {
public:
    Stepper(OpenMM::ContextImpl& context, Scene& scene, ContextMirror& mirror);
    /**
     * Take steps. Each step takes in changes by others, makes sure of current forces, runs the
     * scheme, and writes new poses, momenta, and particle positions and velocities. After an
     * exception, bodies and particles are as they were before the scheme began.
     */
    void takeSteps(int number);
    /**
     * Prepare for steps that another class takes (NativeSteps): take in changes by others, adopt
     * settings, and write what the Context must have at the start of a step.
     */
    void makeReady();
    Forces& getForces() { return forces; }
    /**
     * Evaluate forces at the present poses and time, and gather them for bodies and free particles.
     */
    void evaluateForces();
    /** virialOf() at present positions. */
    Eigen::Matrix3d findVirial();
    /**
     * The mid-step kinetic energies of the present state (MidStep.h). This evaluates forces that
     * are out of date. The next step evaluates its own forces, so this call does not change it.
     */
    MidStepEnergies findMidStepEnergies();

private:
    template <class Work>
    void withArrays(const Work& work);
    void takeStep();
    void startStep();
    void takeInChanges();
    void useOwnNoise();
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
