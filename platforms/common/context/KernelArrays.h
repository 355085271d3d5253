#ifndef RIGIDHI_KERNEL_ARRAYS_H_
#define RIGIDHI_KERNEL_ARRAYS_H_

#include <openmm/Kernel.h>
#include <openmm/VerletIntegrator.h>
#include <openmm/internal/ContextImpl.h>

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "context/ActingForces.h"
#include "context/ContextArrays.h"
#include "context/PeriodicImages.h"

namespace OpenMM {
class UpdateStateDataKernel;
}

namespace RigidHIPlugin {

/**
 * Arrays of a platform that keeps particles in its own form. They are copies on the host, which
 * OpenMM's UpdateStateDataKernel pulls and pushes.
 *
 * This class has an UpdateStateDataKernel of its own, since ContextImpl's setters would tell every
 * listener of a change at every call. The doubles of the host take precedence: a pull takes over
 * only entries that differ from the pushed ones by more than the platform's rounding.
 *
 * A transfer costs as much as a small step, so this class repeats none. Within a user's step(n) it
 * pulls only arrays that Forces may have changed, and pushes no array that the device already has.
 * It pushes velocities only when somebody may read them.
 */
class KernelArrays : public ContextArrays {
public:
    explicit KernelArrays(OpenMM::ContextImpl& context);
    void pullPositions() override;
    void pullVelocities() override;
    void pullForces() override;
    void pushPositions() override;
    void pushVelocities() override;
    void pushPositionsForForces() override;
    void beginSteps() override;
    void endSteps() override;
    void pushEndOfStep() override;
    void beforeForcesAct() override;
    void afterForcesActed(bool movedParticles) override;
    void wereWrittenThere(bool agree) override;
    void leaveRounding(bool leave) override { leavesRounding = leave; }
    void watchSorting(std::function<bool()> sorted) override { wasSorted = std::move(sorted); }
    bool forcesAreFixedPoint() const override { return true; }
    Rounding rounding() const override { return rounding_; }
    long long getNumTransfers() const override {
        return transfers_.positionsPulled + transfers_.velocitiesPulled + transfers_.forcesPulled +
               transfers_.positionsPushed + transfers_.velocitiesPushed;
    }
    double largestSummand(const std::vector<OpenMM::Vec3>& velocities) const override;
    bool removesMomentumExactly() const override { return rounding_.isExact(); }
    void getBox(OpenMM::Vec3 (&box)[3]) const override {
        context.getPeriodicBoxVectors(box[0], box[1], box[2]);
    }
    double getTime() const override;
    void setTime(double time) override;
    long long getStepCount() const override;
    void setStepCount(long long count) override;
    void checkVirtualSites() const override;
    void computeVirtualSites() override;
    OpenMM::ReferenceConstraints* constraints() override { return nullptr; }

    /** The number of transfers of arrays from and to the platform. */
    struct Transfers {
        long long positionsPulled = 0, velocitiesPulled = 0, forcesPulled = 0, positionsPushed = 0,
                  velocitiesPushed = 0;
    };
    const Transfers& transfers() const { return transfers_; }

private:
    /**
     * Whether this class ignores velocity changes of a CMMotionRemover, because the plugin removes
     * momentum itself.
     */
    bool removersAreIgnored() const { return !removesMomentumExactly(); }
    bool velocitiesAreActedOn() const {
        return !acting.other.empty() || (acting.removers && !removersAreIgnored());
    }
    bool positionsAreActedOn() const { return !acting.other.empty() || acting.barostats; }
    /** The platform's state of an array. */
    struct Device {
        std::vector<OpenMM::Vec3> shown;  // the array that the platform last got or returned
        bool isShown = false;             // it holds `shown`, except for rounding; else push anew
        bool isKnown = false;             // nobody else can have changed it since
        bool isImage = false;             // except for periodic images
    };
    OpenMM::UpdateStateDataKernel& kernel() const;
    void give(const std::vector<OpenMM::Vec3>& positions);
    /** Whether a sort has moved molecules to images on which some Force acts differently. */
    bool sortMatters() const { return seesImages && wasSorted && wasSorted(); }
    void requireFinite(const std::vector<OpenMM::Vec3>& array, const char* what) const;
    OpenMM::ContextImpl& context;
    OpenMM::VerletIntegrator
        sizes;  // OpenMM's device platforms make their buffers for an integrator of OpenMM
    OpenMM::Kernel buffers, handle;
    const Rounding rounding_;
    const bool isPeriodic, seesImages;
    const ActingForces acting;
    std::function<bool()> wasSorted;  // empty: nobody knows
    bool agree(const std::vector<OpenMM::Vec3>& own, const Device& there, double relative,
               double beside) const;
    bool inSteps = false, leavesRounding = false;
    Device positionsThere, velocitiesThere;
    OpenMM::Vec3 boxBefore[3];
    std::vector<int> virtualSites;
    std::unique_ptr<PeriodicImages> images;  // where positions are rounded coarsely far from a box
    Transfers transfers_;
    std::vector<OpenMM::Vec3> ownPositions, ownVelocities, ownForces, read, imagePositions;
};

}  // namespace RigidHIPlugin

#endif
