#ifndef RIGIDHI_FREE_FLOW_H_
#define RIGIDHI_FREE_FLOW_H_

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * Add the flow of sources in unbounded fluid, with forces spread over surfaces, in units of 1/(8 pi
 * eta). Cost: 30 ns for each particle and point.
 */
void addFreeFlowAt(const HydrodynamicParticles& particles,
                   const std::vector<OpenMM::Vec3>& positions, const FlowSources& sources,
                   const std::vector<OpenMM::Vec3>& points, double factor, Velocities& velocities);

}  // namespace RigidHIPlugin

#endif
