#ifndef RIGIDHI_REFERENCE_ARRAYS_H_
#define RIGIDHI_REFERENCE_ARRAYS_H_

#include <openmm/internal/ContextImpl.h>
#include <openmm/reference/ReferencePlatform.h>

#include <cmath>
#include <cstddef>
#include <vector>

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
    void pullForces() override {
        for (const Mended& one : mended) positions()[one.particle][one.axis] = one.coordinate;
        mended.clear();
    }
    void pushPositions() override {}
    void pushPositionsForForces() override {
        mended.clear();
        mendPositionsForForces();
    }
    /**
     * OpenMM's Reference platform wraps positions into the box when it looks for neighbours. A
     * coordinate just below 0, or just below another multiple of the edge, may be rounded into a
     * cell that does not exist, and the particle loses all forces with a cut-off. Such a coordinate
     * becomes the multiple until the forces are pulled.
     */
    void mendPositionsForForces() override {
        if (!losesNeighbours) return;
        for (size_t p = 0; p < positions().size(); p++)
            for (int k = 0; k < 3; k++) {
                double& x = positions()[p][k];
                const double edge = data.periodicBoxVectors[k][k], rounding = 1e-15, farAway = 1e6;
                const auto wrapped = [edge](double x) { return x - edge * std::floor(x / edge); };
                if (!(std::abs(x) < farAway * edge) ||
                    (wrapped(x) >= 0 && wrapped(x) <= edge * (1 - rounding)))
                    continue;
                mended.push_back({p, k, x});
                x = edge * std::round(x / edge);
                while (!(wrapped(x) >= 0 && wrapped(x) < edge / 2)) x = std::nextafter(x, INFINITY);
            }
    }
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
          data(data), losesNeighbours(context.getPlatform().getName() == "Reference" &&
                                      context.getSystem().usesPeriodicBoundaryConditions()) {}
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
    const bool losesNeighbours;
    struct Mended {
        std::size_t particle;
        int axis;
        double coordinate;
    };
    std::vector<Mended> mended;
};

}  // namespace RigidHIPlugin

#endif
