#ifndef RIGIDHI_REFERENCE_ARRAYS_H_
#define RIGIDHI_REFERENCE_ARRAYS_H_

#include <openmm/internal/ContextImpl.h>
#include <openmm/reference/ReferencePlatform.h>

#include "context/ContextArrays.h"

namespace RigidHIPlugin {

/**
 * The arrays of OpenMM's Reference and CPU platforms. They are the Context's own, so that pulls and
 * pushes do nothing.
 */
class ReferenceArrays : public ContextArrays {
public:
    explicit ReferenceArrays(OpenMM::ContextImpl& context)
        : ReferenceArrays(context, *static_cast<OpenMM::ReferencePlatform::PlatformData*>(
                                       context.getPlatformData())) {}
    void pullPositions() override {}
    void pullVelocities() override {}
    void pullForces() override {}
    void pushPositions() override {}
    void pushVelocities() override {}
    void getBox(OpenMM::Vec3 (&box)[3]) const override {
        std::copy_n(data.periodicBoxVectors, 3, box);
    }
    double getTime() const override { return data.time; }
    void setTime(double time) override { data.time = time; }
    long long getStepCount() const override { return data.stepCount; }
    void setStepCount(long long count) override { data.stepCount = count; }
    void computeVirtualSites() override { context.computeVirtualSites(); }
    OpenMM::ReferenceConstraints* constraints() override { return data.constraints; }

private:
    ReferenceArrays(OpenMM::ContextImpl& context, OpenMM::ReferencePlatform::PlatformData& data)
        : ContextArrays(*data.positions, *data.velocities, *data.forces), context(context),
          data(data) {}
    OpenMM::ContextImpl& context;
    OpenMM::ReferencePlatform::PlatformData& data;
};

}  // namespace RigidHIPlugin

#endif
