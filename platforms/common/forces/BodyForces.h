#ifndef RIGIDHI_BODY_FORCES_H_
#define RIGIDHI_BODY_FORCES_H_

#include <openmm/internal/ContextImpl.h>

#include <memory>
#include <string>
#include <vector>

#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/**
 * All CustomBodyForces of a Context, ready for evaluation. Without such forces isOn() is false,
 * callers need no other method, and the cost is zero.
 */
class BodyForces {
public:
    BodyForces();
    ~BodyForces();
    /**
     * Find the forces of a Context and compile their expressions. @throws OpenMMException for an
     * expression that does not compile
     */
    explicit BodyForces(OpenMM::ContextImpl& context);
    BodyForces& operator=(BodyForces&&);

    /** Whether any force of these groups acts on any body. */
    bool isOn(int groups) const;
    /** Whether any expression depends on time, or on velocities. */
    bool usesTime() const { return time; }
    bool usesVelocities() const { return velocities; }
    /** The force that depends on velocities, for messages. */
    std::string velocityDependence() const;
    /**
     * Add the forces and torques of these groups to the present ones of the bodies.
     *
     * @param t          time, ps
     * @param lookAhead  expressions use the velocities after a kick of this length, ps; with 0, the
     *     present velocities
     * @return whether all forces and torques are finite
     */
    bool add(OpenMM::ContextImpl& context, BodySet& bodies, int groups, double t, double lookAhead);
    /** Restore the forces and torques before the last add(). Call this only if usesVelocities(). */
    void removeLast(BodySet& bodies) const;
    /** For describeEffects(). */
    std::string describe(int groups) const;

private:
    struct Force;
    void setVelocities(const BodySet& bodies, double lookAhead);
    void addOnce(OpenMM::ContextImpl& context, BodySet& bodies, int groups, double t);
    std::vector<std::unique_ptr<Force>> forces;
    bool time = false, velocities = false;
    BodySet::Snapshot before;            // of the forces, before add()
    std::vector<OpenMM::Vec3> velocity;  // of bodies, as expressions use them
};

}  // namespace RigidHIPlugin

#endif
