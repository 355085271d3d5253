#ifndef RIGIDHI_FORCES_H_
#define RIGIDHI_FORCES_H_

#include <openmm/internal/ContextImpl.h>

#include "context/ContextMirror.h"
#include "stepping/ForceChoice.h"

namespace RigidHIPlugin {

/**
 * Forces on bodies and free particles: OpenMM's, and what CustomBodyForces add.
 *
 * Those at the end of a step serve the next one, unless anything changed in between.
 */
class Forces {
public:
    Forces(OpenMM::ContextImpl& context, Scene& scene, ContextMirror& mirror)
        : context(context), scene(scene), mirror(mirror) {}
    /** A step begins: make sure that there are the forces with which its scheme begins. */
    void prepare();
    /** Evaluate and gather them at the present positions. @param time  of CustomBodyForces, ps */
    void evaluate(double time);
    /**
     * Likewise for the AfterForces loop, which itself gathers forces on bodies where no
     * CustomBodyForce adds to them.
     * @param lookAhead  BodyForces::add()
     */
    void evaluateForAfterForces(double time, double lookAhead);
    /** Forces that depend on velocities are evaluated anew with the present ones; the others stay.
     */
    void renewVelocityDependent(double time);
    /** They belong to no configuration that a step may begin with. */
    void drop() { evaluatedAfter = -1; }
    /** A step is given up, and bodies and free particles are to have the forces with which it
     * began. */
    void stepFailed();

private:
    bool areCurrent() const { return evaluatedAfter == scene.numChanges(); }
    void calculate();
    void addBodyForces(double time, double lookAhead);
    OpenMM::ContextImpl& context;
    Scene& scene;
    ContextMirror& mirror;
    ForceChoice choice;
    double bodyForcesTime = 0;      // of the forces that the bodies have
    long long evaluatedAfter = -1;  // as many changes by others; -1: not current
};

}  // namespace RigidHIPlugin

#endif
