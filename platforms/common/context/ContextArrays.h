#ifndef RIGIDHI_CONTEXT_ARRAYS_H_
#define RIGIDHI_CONTEXT_ARRAYS_H_

#include <openmm/Vec3.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "context/Rounding.h"

namespace OpenMM {
class ReferenceConstraints;
}

namespace RigidHIPlugin {

/**
 * Access to positions, velocities, forces, box, time and step count of a Context. No other code
 * reads or writes them.
 *
 * All code works on the arrays of this class, in double precision on the host. They are the
 * Context's own, or copies that are pulled from the Context and pushed to it. A pull keeps the bits
 * of all numbers that nobody else has changed since the last push by more than the rounding of the
 * platform. A comparison of bits therefore shows exactly what others changed.
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
    /**
     * Give the Context positions at which OpenMM is to compute forces. These may be periodic
     * images. pushPositions() later gives the real positions.
     */
    virtual void pushPositionsForForces() { pushPositions(); }
    /**
     * Round coordinates of positions() at which the platform's forces are wrong, by less than their
     * rounding in the box. Callers that change positions() for an evaluation call this method.
     */
    virtual void mendPositionsForForces() {}

    /**
     * A user's step(n) begins and ends. Between these two calls others touch the Context only where
     * a step lets them. Meanwhile arrays that are copies need no second pull, and no push before
     * somebody can read them. endSteps() pushes what was not pushed yet, also after an error.
     */
    virtual void beginSteps() {}
    virtual void endSteps() {}
    /**
     * A step between these two calls is complete. Others may read positions and velocities, now or
     * when the steps have ended.
     */
    virtual void pushEndOfStep() {}
    /**
     * Called before and after ContextImpl::updateContextState(), where Forces read positions and
     * velocities and change them.
     */
    virtual void beforeForcesAct() {}
    /**
     * @param movedParticles  what updateContextState() returned: whether known forces have become
     *     invalid
     */
    virtual void afterForcesActed(bool movedParticles) {}

    /**
     * The platform itself has moved particles, and the arrays have been brought up to date.
     * @param agree  whether the Context has what the arrays have, except for rounding; if not, the
     *     arrays must be pushed
     */
    virtual void wereWrittenThere(bool agree) {}

    /**
     * Set whether pushes may leave out numbers that differ from the Context's only by rounding,
     * because the platform itself will write them (NativeSteps).
     */
    virtual void leaveRounding(bool leave) {}
    /**
     * Let the arrays ask whether OpenMM has sorted the particles since the last call of `sorted`.
     * OpenMM then moves molecules into the box, where Forces that are not periodic act on other
     * images.
     */
    virtual void watchSorting(std::function<bool()> sorted) {}

    /**
     * Whether the platform adds up forces as fixed-point numbers, as OpenMM does on devices. Two
     * contributions that are not finite then cancel.
     */
    virtual bool forcesAreFixedPoint() const { return false; }

    /** How far a number that the platform returns may be from the number it was given. */
    virtual Rounding rounding() const { return Rounding(); }
    /**
     * Whether a CMMotionRemover acts at the steps that its frequency names, and in double
     * precision.
     */
    virtual bool removesMomentumExactly() const { return true; }

    /** How often an array went from or to a device since Context creation. */
    virtual long long getNumTransfers() const { return 0; }

    virtual void getBox(OpenMM::Vec3 (&box)[3]) const = 0;
    /** Whether setBox() can follow a box that tilts. */
    virtual bool canSetBox() const { return false; }
    /**
     * Give the Context another box, and make OpenMM find neighbours anew. Call this only where
     * canSetBox().
     */
    virtual void setBox(const OpenMM::Vec3 (&box)[3]) {}
    /**
     * The longest edge of the box. The platform may round positions after it has added this length
     * to them.
     */
    double longestEdge() const {
        OpenMM::Vec3 box[3];
        getBox(box);
        double longest = 0;
        for (const OpenMM::Vec3& edge : box) longest = std::max(longest, std::sqrt(edge.dot(edge)));
        return longest;
    }
    /**
     * The largest speed among these velocities, if the platform's own steps round velocities as
     * sums of such numbers (a body's velocity and that due to its rotation); else 0.
     */
    virtual double largestSummand(const std::vector<OpenMM::Vec3>& velocities) const { return 0; }
    virtual double getTime() const = 0;
    virtual void setTime(double time) = 0;
    virtual long long getStepCount() const = 0;
    virtual void setStepCount(long long count) = 0;
    /** Throws if computeVirtualSites() cannot place a virtual site of the System. */
    virtual void checkVirtualSites() const {}
    /** Place the virtual sites by the positions of the arrays, and write them to the arrays. */
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
