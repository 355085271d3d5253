#ifndef RIGIDHI_DEVICE_LOOPS_H_
#define RIGIDHI_DEVICE_LOOPS_H_

#include <openmm/common/ComputeContext.h>

#include <memory>
#include <string>

#include "DevicePairs.h"
#include "host/ThreadedLoops.h"

namespace RigidHIPlugin {

/**
 * Loops of the host, with a device for products. The device makes products with the mobility of
 * many particles if these may have errors and the device is faster.
 */
class DeviceLoops : public ThreadedLoops {
public:
    /**
     * @param cc        the context of the platform's first device
     * @param platform  its name
     * @throws OpenMMException as productWish()
     */
    DeviceLoops(int threads, OpenMM::ComputeContext& cc, const std::string& platform)
        : ThreadedLoops(threads),
          pairs(std::make_shared<DevicePairs>(cc, platform, productWish())) {}
    std::pair<bool, std::string> describeProducts() const override {
        return {pairs->isOn(), pairs->describe()};
    }

protected:
    std::unique_ptr<MobilityModel> createRotnePragerYamakawa(
        const HydrodynamicParticles& particles, double viscosity,
        const CpuRotnePragerYamakawa::ForRanges& threads, const std::optional<NoSlipPlane>& wall,
        bool fastSums) override;

private:
    const std::shared_ptr<DevicePairs> pairs;
};

}  // namespace RigidHIPlugin

#endif
