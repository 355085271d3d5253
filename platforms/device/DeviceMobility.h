#ifndef RIGIDHI_DEVICE_MOBILITY_H_
#define RIGIDHI_DEVICE_MOBILITY_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "DevicePairs.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"

namespace RigidHIPlugin {

/**
 * The Rotne-Prager-Yamakawa mobility of the host, but a device makes products that may have the
 * error of single precision. The host does all else, and also makes the products if the device
 * fails.
 */
class DeviceRotnePragerYamakawa : public CpuRotnePragerYamakawa {
public:
    /** Arguments as those of CpuRotnePragerYamakawa. */
    DeviceRotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity,
                              const ForRanges& forRanges, const std::optional<NoSlipPlane>& wall,
                              bool fastSums, const std::shared_ptr<DevicePairs>& pairs);
    /** Whether the device makes any products of such a model. */
    static bool isWorthIt(const DevicePairs& pairs, const HydrodynamicParticles& particles,
                          const std::optional<NoSlipPlane>& wall, bool fastSums);
    /**
     * Products of the device have smaller errors than this, and larger errors would save no time
     * there.
     */
    bool hasFastProducts(double error) const override {
        return !isOnDevice(error) && CpuRotnePragerYamakawa::hasFastProducts(error);
    }
    std::string describeFastProducts(double error) const override {
        return isOnDevice(error) ? "by the device, over all pairs in floats"
                                 : CpuRotnePragerYamakawa::describeFastProducts(error);
    }
    /** Whether the device makes products of such an error. */
    bool isOnDevice(double error) const;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    friend class DeviceRotnePragerYamakawaAt;
    const std::shared_ptr<DevicePairs> pairs;
    const DevicePairs::Note note;
    const PairKind kind;
    const bool fastSums;
    const double length;                  // the unit of length on the device, a power of two near
                                          // the radii
    std::vector<double> radii, ttI, rrI;  // in this unit; of each sphere by itself, times 8 pi eta
};

/** A DeviceRotnePragerYamakawa at a placement. */
class DeviceRotnePragerYamakawaAt : public CpuRotnePragerYamakawaAt {
public:
    explicit DeviceRotnePragerYamakawaAt(const DeviceRotnePragerYamakawa& model);
    void multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                  const Accuracy& accuracy) override;

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    bool multiplyOnDevice(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities);
    const DeviceRotnePragerYamakawa& model;
    DevicePairs::PlacedSpheres place;
    bool isPlaced = false;
    std::vector<double> weights;  // factors of forces and velocities
    Eigen::MatrixXd loads, sums;
};

}  // namespace RigidHIPlugin

#endif
