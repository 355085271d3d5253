#ifndef RIGIDHI_FORCES_H_
#define RIGIDHI_FORCES_H_

#include <openmm/internal/ContextImpl.h>

#include <functional>

#include "context/ContextMirror.h"
#include "stepping/ForceChoice.h"

namespace RigidHIPlugin {

/**
 * Forces on bodies and free particles: OpenMM's forces, and those of CustomBodyForces.
 *
 * The forces at the end of a step serve the next step, unless anything has changed meanwhile.
 */
class Forces {
public:
    Forces(OpenMM::ContextImpl& context, Scene& scene, ContextMirror& mirror)
        : context(context), scene(scene), mirror(mirror) {}
    /** Prepare a step: evaluate the forces that its scheme begins with, unless they are current. */
    void prepare();
    /**
     * Evaluate and gather forces at the present positions.
     *
     * @param time  for CustomBodyForces, ps
     */
    void evaluate(double time);
    /**
     * Evaluate forces for the AfterForces loop. This loop gathers forces on bodies itself where no
     * CustomBodyForce adds to them.
     * @param lookAhead  as in BodyForces::add()
     */
    void evaluateForAfterForces(double time, double lookAhead);
    /**
     * Evaluate the forces that depend on velocities anew, with the present velocities. The other
     * forces stay.
     */
    void renewVelocityDependent(double time);
    /**
     * Call work() while bodies and free particles have the forces that the next step would begin
     * with at the present state. Afterwards bodies have their earlier forces again. Forces
     * evaluated here do not count as current, so the next step evaluates them again, and is the
     * same as without this call.
     */
    void withThoseOfNextStep(const std::function<void()>& work);
    /** Say that the forces belong to no configuration that a step may begin with. */
    void drop() { evaluatedAfter = -1; }
    /** Whether a step that begins at this time may begin with the forces that bodies have. */
    bool areCurrentAt(double time) {
        dropIfOutOfDate(time);
        return areCurrent();
    }
    /**
     * Say that somebody else has evaluated forces at the present positions, without any
     * CustomBodyForce.
     */
    void wereEvaluated();
    /**
     * Call it after forces were evaluated: whether to check the potential energy. On platforms with
     * fixed-point forces this is so at positions that were set, and once in many steps.
     */
    bool energyIsDue();
    /**
     * Evaluate the energy. OpenMM then no longer has the forces.
     * @throws OpenMMException if it is not finite
     */
    void checkEnergy();
    /**
     * Say that a step was given up. StartOfStep gives bodies and free particles the forces that the
     * step began with.
     */
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
    long long evaluationsSinceCheck = 0;
    double bodyForcesTime = 0;      // of the forces that the bodies have
    long long evaluatedAfter = -1;  // scene.numChanges() at the evaluation; -1: not current
};

}  // namespace RigidHIPlugin

#endif
