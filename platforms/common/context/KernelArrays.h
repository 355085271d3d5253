#ifndef RIGIDHI_KERNEL_ARRAYS_H_
#define RIGIDHI_KERNEL_ARRAYS_H_

#include <openmm/Kernel.h>
#include <openmm/VerletIntegrator.h>
#include <openmm/internal/ContextImpl.h>

#include <memory>
#include <vector>

#include "context/ActingForces.h"
#include "context/ContextArrays.h"
#include "context/PeriodicImages.h"

namespace OpenMM {
class UpdateStateDataKernel;
}

namespace RigidHIPlugin {

/**
 * Arrays of a platform that keeps particles in a way of its own: copies on the host, which OpenMM's
 * UpdateStateDataKernel pulls and pushes.
 *
 * The kernel is our own, since ContextImpl's setters would tell every listener of a change at every
 * call. The doubles of the host are what counts: a pull takes over only those entries that differ
 * from what was pushed by more than the platform's rounding.
 *
 * A transfer costs as much as a small step, so none is made twice: within a user's step(n) nothing
 * is pulled but what Forces may have changed, nothing is pushed that the device has already, and
 * velocities go there when somebody may look.
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
    Rounding rounding() const override { return rounding_; }
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

    /** How often arrays went from and to the platform. */
    struct Transfers {
        long long positionsPulled = 0, velocitiesPulled = 0, forcesPulled = 0, positionsPushed = 0,
                  velocitiesPushed = 0;
    };
    const Transfers& transfers() const { return transfers_; }

private:
    /** Of what a CMMotionRemover does here nothing is kept, since the removal is ours. */
    bool removersAreIgnored() const { return !removesMomentumExactly(); }
    bool velocitiesAreActedOn() const {
        return acting.others || (acting.removers && !removersAreIgnored());
    }
    bool positionsAreActedOn() const { return acting.others || acting.barostats; }
    /** Of an array what the platform knows of it. */
    struct Device {
        std::vector<OpenMM::Vec3> shown;  // what it was given, or gave, last
        bool isShown = false;  // it holds that, but for rounding; else it is to be given anew
        bool isKnown = false;  // nobody else can have changed it since
        bool isImage = false;  // but for periodic images
    };
    OpenMM::UpdateStateDataKernel& kernel() const;
    void give(const std::vector<OpenMM::Vec3>& positions);
    void requireFinite(const std::vector<OpenMM::Vec3>& array, const char* what) const;
    OpenMM::ContextImpl& context;
    OpenMM::VerletIntegrator
        sizes;  // OpenMM's device platforms make their buffers for an integrator of OpenMM's
    OpenMM::Kernel buffers, handle;
    const Rounding rounding_;
    const bool isPeriodic;
    const ActingForces acting;
    bool inSteps = false;
    Device positionsThere, velocitiesThere;
    OpenMM::Vec3 boxBefore[3];
    std::vector<int> virtualSites;
    std::unique_ptr<PeriodicImages> images;  // where positions are rounded coarsely far from a box
    Transfers transfers_;
    std::vector<OpenMM::Vec3> ownPositions, ownVelocities, ownForces, read, imagePositions;
};

}  // namespace RigidHIPlugin

#endif
