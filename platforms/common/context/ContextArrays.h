#ifndef RIGIDHI_CONTEXT_ARRAYS_H_
#define RIGIDHI_CONTEXT_ARRAYS_H_

#include <openmm/Vec3.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "context/Rounding.h"

namespace OpenMM {
class ReferenceConstraints;
}

namespace RigidHIPlugin {

/**
 * Where positions, velocities, forces, box, time and step count of a Context lie: the one way to
 * them.
 *
 * Everybody works on the arrays that this hands out, in double precision on the host. They are the
 * Context's own, or copies that are pulled from it and pushed to it. What nobody else has changed
 * since the last push, by more than the rounding of the platform, keeps its bits when it is pulled.
 * So whoever compares bits sees what others did, and only that.
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
    /** Give it positions of which OpenMM is to compute forces, which may be those of periodic
     * images; pushPositions() later gives the others. */
    virtual void pushPositionsForForces() { pushPositions(); }

    /**
     * A user's step(n) begins and ends. In between others touch the Context only where a step lets
     * them, so that arrays which are copies need not be pulled again, and need not be pushed before
     * somebody can look. The end pushes what is owed, also after an error.
     */
    virtual void beginSteps() {}
    virtual void endSteps() {}
    /** A step within these two is complete: others may look at positions and velocities, now or
     * when the steps have ended. */
    virtual void pushEndOfStep() {}
    /** Around ContextImpl::updateContextState(), where Forces look at positions and velocities and
     * change them. */
    virtual void beforeForcesAct() {}
    /** @param movedParticles  what updateContextState() returned: whether forces that were known
     * are invalid now */
    virtual void afterForcesActed(bool movedParticles) {}

    /** How far a number that the platform gives back may be from the one it was given. */
    virtual Rounding rounding() const { return Rounding(); }
    /** Whether a CMMotionRemover acts at the steps that its frequency names, and in double
     * precision. */
    virtual bool removesMomentumExactly() const { return true; }

    virtual void getBox(OpenMM::Vec3 (&box)[3]) const = 0;
    /** The longest edge of the box: where positions are rounded, as much as that may have been
     * added to them. */
    double longestEdge() const {
        OpenMM::Vec3 box[3];
        getBox(box);
        double longest = 0;
        for (const OpenMM::Vec3& edge : box) longest = std::max(longest, std::sqrt(edge.dot(edge)));
        return longest;
    }
    virtual double getTime() const = 0;
    virtual void setTime(double time) = 0;
    virtual long long getStepCount() const = 0;
    virtual void setStepCount(long long count) = 0;
    /** Throws if computeVirtualSites() cannot place one of the System. */
    virtual void checkVirtualSites() const {}
    /** Place the virtual sites by the positions of the arrays, to which they come back. */
    virtual void computeVirtualSites() = 0;
    /** OpenMM's constraints of the whole System, for arrays on the host; null where the platform
     * has none. */
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
