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
 * The Rotne-Prager-Yamakawa mobility of the host, whose products are made by a device where they
 * may have the error of single precision. All else is done by the host, and products as well where
 * the device fails.
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
    /** The device's products have smaller errors and take no less time for larger ones. */
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
    const double length;                  // a power of two near the radii, the device's unit
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
    DevicePairs::Place place;
    bool isPlaced = false;
    std::vector<double> weights;  // by which forces and velocities are multiplied
    Eigen::MatrixXd loads, sums;
};

}  // namespace RigidHIPlugin

#endif
