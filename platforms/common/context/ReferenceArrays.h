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
    bool canSetBox() const override { return true; }
    void setBox(const OpenMM::Vec3 (&box)[3]) override {
        for (int k = 0; k < 3; k++) {
            data.periodicBoxVectors[k] = box[k];
            (*data.periodicBoxSize)[k] = box[k][k];
        }
        forgetNeighbours();
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
    /**
     * The CPU platform keeps a list of neighbours until a particle has moved, and does not look at
     * the box. This method therefore moves a particle away by an edge while OpenMM looks at
     * positions without computing forces, so that the next force evaluation makes a new list.
     */
    void forgetNeighbours() {
        if (context.getPlatform().getName() == "Reference" || data.positions->empty()) return;
        OpenMM::Vec3& first = data.positions->front();
        const OpenMM::Vec3 place = first;
        first += data.periodicBoxVectors[0];
        try {
            const int noGroups = 0;
            context.calcForcesAndEnergy(true, false, noGroups);
        } catch (...) {
            data.positions->front() = place;
            throw;
        }
        data.positions->front() = place;
    }
    OpenMM::ContextImpl& context;
    OpenMM::ReferencePlatform::PlatformData& data;
};

}  // namespace RigidHIPlugin

#endif
