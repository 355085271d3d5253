#ifndef RIGIDHI_FORCES_H_
#define RIGIDHI_FORCES_H_

#include <openmm/internal/ContextImpl.h>

#include <functional>

#include "context/ContextMirror.h"
#include "stepping/ForceChoice.h"

namespace RigidHIPlugin {

/**
 * Forces on bodies and free particles: OpenMM's, and those of CustomBodyForces.
 *
 * The forces at the end of a step serve the next one, unless anything changed meanwhile.
 */
class Forces {
public:
    Forces(OpenMM::ContextImpl& context, Scene& scene, ContextMirror& mirror)
        : context(context), scene(scene), mirror(mirror) {}
    /** A step begins: make sure that the forces that its scheme begins with are there. */
    void prepare();
    /**
     * Evaluate and gather forces at the present positions. @param time  for CustomBodyForces, ps
     */
    void evaluate(double time);
    /**
     * Evaluate forces for the AfterForces loop. This loop gathers forces on bodies itself where no
     * CustomBodyForce adds to them.
     * @param lookAhead  as in BodyForces::add()
     */
    void evaluateForAfterForces(double time, double lookAhead);
    /**
     * Evaluate forces that depend on velocities anew with the present velocities. The other forces
     * stay.
     */
    void renewVelocityDependent(double time);
    /**
     * Call work() while bodies and free particles have the forces that the next step begins with at
     * the present state. Bodies then have again those that they had. The next step evaluates what
     * had to be evaluated here once more, so that it is the same.
     */
    void withThoseOfNextStep(const std::function<void()>& work);
    /** The forces belong to no configuration that a step may begin with. */
    void drop() { evaluatedAfter = -1; }
    /** Whether a step that begins at this time may begin with the forces that bodies have. */
    bool areCurrentAt(double time) {
        dropIfOutOfDate(time);
        return areCurrent();
    }
    /** Somebody else has evaluated forces at the present positions. */
    void wereEvaluated() { evaluatedAfter = scene.numChanges(); }
    /** A step is given up. Bodies and free particles get the forces that it began with. */
    void stepFailed();

private:
    bool areCurrent() const { return evaluatedAfter == scene.numChanges(); }
    void dropIfOutOfDate(double time);
    void calculate();
    void addBodyForces(double time, double lookAhead);
    OpenMM::ContextImpl& context;
    Scene& scene;
    ContextMirror& mirror;
    ForceChoice choice;
    BodySet::Snapshot shown;
    double bodyForcesTime = 0;      // of the forces that the bodies have
    long long evaluatedAfter = -1;  // as many changes by others; -1: not current
};

}  // namespace RigidHIPlugin

#endif
