#ifndef RIGIDHI_KERNEL_ARRAYS_H_
#define RIGIDHI_KERNEL_ARRAYS_H_

#include <openmm/Kernel.h>
#include <openmm/internal/ContextImpl.h>

#include <vector>

#include "context/ContextArrays.h"

namespace OpenMM {
class UpdateStateDataKernel;
}

namespace RigidHIPlugin {

/**
 * Arrays of a platform that keeps particles in a way of its own: copies on the host, which OpenMM's UpdateStateDataKernel pulls and pushes.
 *
 * The kernel is our own, since ContextImpl's setters would tell every listener of a change at every call. What was pushed is read back at
 * once: a later pull takes only those entries that differ from that, so that what nobody has changed keeps its double precision.
 */
class KernelArrays : public ContextArrays {
public:
    explicit KernelArrays(OpenMM::ContextImpl& context);
    void pullPositions() override;
    void pullVelocities() override;
    void pullForces() override;
    void pushPositions() override;
    void pushVelocities() override;
    void getBox(OpenMM::Vec3 (&box)[3]) const override { context.getPeriodicBoxVectors(box[0], box[1], box[2]); }
    double getTime() const override;
    void setTime(double time) override;
    long long getStepCount() const override;
    void setStepCount(long long count) override;
    void computeVirtualSites() override;
    OpenMM::ReferenceConstraints* constraints() override { return nullptr; }

private:
    OpenMM::UpdateStateDataKernel& kernel() const;
    OpenMM::ContextImpl& context;
    OpenMM::Kernel handle;
    std::vector<OpenMM::Vec3> ownPositions, ownVelocities, ownForces;
    std::vector<OpenMM::Vec3> readPositions, readVelocities, read;  // as the platform gave them last
};

}  // namespace RigidHIPlugin

#endif
