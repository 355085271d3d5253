#ifndef RIGIDHI_DEVICE_LOOPS_H_
#define RIGIDHI_DEVICE_LOOPS_H_

#include <memory>
#include <string>
#include <utility>

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
     * @param device    the platform's first device
     * @param platform  name of the platform
     * @throws OpenMMException as productWish()
     */
    DeviceLoops(int threads, std::unique_ptr<const Device> device, const std::string& platform)
        : ThreadedLoops(threads),
          pairs(std::make_shared<DevicePairs>(std::move(device), platform, productWish())) {}
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
