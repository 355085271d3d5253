#include "DeviceLoops.h"

#include "DeviceMobility.h"

namespace RigidHIPlugin {

std::unique_ptr<MobilityModel> DeviceLoops::createRotnePragerYamakawa(
    const HydrodynamicParticles& particles, double viscosity,
    const CpuRotnePragerYamakawa::ForRanges& threads, const std::optional<NoSlipPlane>& wall,
    bool fastSums) {
    if (!DeviceRotnePragerYamakawa::isWorthIt(*pairs, particles, wall, fastSums))
        return ThreadedLoops::createRotnePragerYamakawa(particles, viscosity, threads, wall,
                                                        fastSums);
    return std::make_unique<DeviceRotnePragerYamakawa>(particles, viscosity, threads, wall,
                                                       fastSums, pairs);
}

}  // namespace RigidHIPlugin
