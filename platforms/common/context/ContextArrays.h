#ifndef RIGIDHI_CONTEXT_ARRAYS_H_
#define RIGIDHI_CONTEXT_ARRAYS_H_

#include <openmm/Vec3.h>

#include <vector>

namespace OpenMM {
class ReferenceConstraints;
}

namespace RigidHIPlugin {

/**
 * Where positions, velocities, forces, box, time and step count of a Context lie: the one way to them.
 *
 * Everybody works on the arrays that this hands out, in double precision on the host. They are the Context's own, or copies that are pulled
 * from it and pushed to it. What nobody else has changed since the last push keeps its bits when it is pulled, whatever the precision
 * of the platform. So whoever compares bits sees what others did, and only that.
 */
class ContextArrays {
public:
    virtual ~ContextArrays() {}
    std::vector<OpenMM::Vec3>& positions() { return positions_; }
    std::vector<OpenMM::Vec3>& velocities() { return velocities_; }
    const std::vector<OpenMM::Vec3>& forces() const { return forces_; }

    /** Bring the arrays up to date with the Context. */
    virtual void pullPositions() = 0;
    virtual void pullVelocities() = 0;
    virtual void pullForces() = 0;
    /** Give the Context what the arrays hold. */
    virtual void pushPositions() = 0;
    virtual void pushVelocities() = 0;

    virtual void getBox(OpenMM::Vec3 (&box)[3]) const = 0;
    virtual double getTime() const = 0;
    virtual void setTime(double time) = 0;
    virtual long long getStepCount() const = 0;
    virtual void setStepCount(long long count) = 0;
    /** Place the virtual sites by the positions of the arrays, to which they come back. */
    virtual void computeVirtualSites() = 0;
    /** OpenMM's constraints of the whole System, for arrays on the host; null where the platform has none. */
    virtual OpenMM::ReferenceConstraints* constraints() = 0;

protected:
    /** The arrays may be members of the class that derives from this one. */
    ContextArrays(std::vector<OpenMM::Vec3>& positions, std::vector<OpenMM::Vec3>& velocities,
                  const std::vector<OpenMM::Vec3>& forces)
        : positions_(positions), velocities_(velocities), forces_(forces) {}

private:
    std::vector<OpenMM::Vec3>&positions_, &velocities_;
    const std::vector<OpenMM::Vec3>& forces_;
};

}  // namespace RigidHIPlugin

#endif
