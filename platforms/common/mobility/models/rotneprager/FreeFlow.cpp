#include "mobility/models/rotneprager/FreeFlow.h"

#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

using Eigen::Vector3d;

void addFreeFlowAt(const HydrodynamicParticles& particles,
                   const std::vector<OpenMM::Vec3>& positions, const FlowSources& sources,
                   const std::vector<OpenMM::Vec3>& points, double factor, Velocities& velocities) {
    const bool stresslets = sources.stresslets.size() > 0;
    for (int j = 0; j < particles.size(); j++) {
        const int row = particles.firstRow[j];
        const Vector3d force = sources.forces.block<3, 1>(row, 0),
                       torque = particles.hasTorque[j]
                                    ? Vector3d(sources.forces.block<3, 1>(row + 3, 0))
                                    : Vector3d(0, 0, 0);
        const double* S = stresslets ? &sources.stresslets[5 * j] : nullptr;
        for (size_t p = 0; p < points.size(); p++) {
            const OpenMM::Vec3 d = points[p] - positions[j];
            const Vector3d r(d[0], d[1], d[2]);
            velocities.col(p) +=
                factor *
                velocityOf(overSurfaces().free(0, particles.radii[j], r.norm(), true, stresslets),
                           r, force, torque, S);
        }
    }
}

}  // namespace RigidHIPlugin
