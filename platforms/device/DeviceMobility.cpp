#include "DeviceMobility.h"

#include <algorithm>
#include <cmath>

#include "mobility/models/rotneprager/RotnePragerYamakawa-inl.h"

using namespace std;
using Eigen::MatrixXd;

namespace RigidHIPlugin {

namespace {

/** A power of two near the radii, so that divisions by it have no rounding errors. */
double lengthFor(const vector<double>& radii) {
    if (radii.empty()) return 1;
    const auto extremes = minmax_element(radii.begin(), radii.end());
    return ldexp(1.0, lround((log2(*extremes.first) + log2(*extremes.second)) / 2));
}

}  // namespace

DeviceRotnePragerYamakawa::DeviceRotnePragerYamakawa(const HydrodynamicParticles& particles,
                                                     double viscosity, const ForRanges& forRanges,
                                                     const optional<NoSlipPlane>& wall,
                                                     bool fastSums,
                                                     const shared_ptr<DevicePairs>& pairs)
    : CpuRotnePragerYamakawa(particles, viscosity, forRanges, wall, fastSums, fastSums),
      pairs(pairs),
      note(*pairs, particles.size()), kind{count(particles.hasTorque.begin(),
                                                 particles.hasTorque.end(), 0) < particles.size(),
                                           wall.has_value()},
      fastSums(fastSums), length(lengthFor(particles.radii)) {
    for (double a : particles.radii) {
        const double radius = a / length;
        const auto own = scalar::overlappingPairMobility(0.0, radius, radius);
        radii.push_back(radius);
        ttI.push_back(own.ttI);
        rrI.push_back(own.rrI);
    }
}

bool DeviceRotnePragerYamakawa::isWorthIt(const DevicePairs& pairs,
                                          const HydrodynamicParticles& particles,
                                          const optional<NoSlipPlane>& wall, bool fastSums) {
    return particles.size() > 0 && pairs.serves(particles.size(), wall.has_value(), fastSums,
                                                Accuracy::errorOfSinglePrecision);
}

bool DeviceRotnePragerYamakawa::isOnDevice(double error) const {
    return traits.hasSinglePrecision &&
           pairs->serves(particles.size(), kind.hasWall, fastSums, error);
}

unique_ptr<MobilityAt> DeviceRotnePragerYamakawa::makePlace() const {
    return make_unique<DeviceRotnePragerYamakawaAt>(*this);
}

DeviceRotnePragerYamakawaAt::DeviceRotnePragerYamakawaAt(const DeviceRotnePragerYamakawa& model)
    : CpuRotnePragerYamakawaAt(model), model(model), place(model.radii, model.kind) {}

void DeviceRotnePragerYamakawaAt::moveTo(const Placement& placement, bool nearby) {
    CpuRotnePragerYamakawaAt::moveTo(placement, nearby);
    isPlaced = false;
}

void DeviceRotnePragerYamakawaAt::multiply(const MatrixXd& forces, MatrixXd& velocities,
                                           const Accuracy& accuracy) {
    // Compilers of kernels may assume that all numbers are finite.
    if (accuracy.allowsSinglePrecision() && model.isOnDevice(accuracy.error) && placesAreFinite() &&
        preparePlacesInSingle() && forces.allFinite() && multiplyOnDevice(forces, velocities))
        return;
    CpuRotnePragerYamakawaAt::multiply(forces, velocities, accuracy);
}

bool DeviceRotnePragerYamakawaAt::multiplyOnDevice(const MatrixXd& forces, MatrixXd& velocities) {
    const double length = model.length;
    if (!isPlaced) {
        vector<OpenMM::Vec3> positions;
        placesInFormulas(positions, weights);
        vector<double> numbers;
        for (const OpenMM::Vec3& r : positions)
            for (int k = 0; k < 3; k++) numbers.push_back(r[k] / length);
        place.moveTo(numbers);
        isPlaced = true;
    }
    const int n = particles.size(), rows = model.kind.hasTorque ? 6 : 3;
    // Scale the loads, since floats hold numbers from 1e-38 to 1e38 only.
    double largest = 0;
    loads.setZero(rows * n, forces.cols());
    for (int c = 0; c < forces.cols(); c++)
        for (int i = 0; i < n; i++)
            for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k++) {
                double& load = loads(rows * i + k, c);
                load = weights[i] * forces(particles.firstRow[i] + k, c) / (k < 3 ? 1 : length);
                largest = max(largest, abs(load));
            }
    if (largest > 0) loads /= largest;
    if (!model.pairs->multiply(place, loads, sums)) return false;
    const double scale = (largest > 0 ? largest : 1) / (8 * M_PI * viscosity * length);
    velocities.resize(particles.numRows, forces.cols());
    for (int c = 0; c < forces.cols(); c++)
        for (int i = 0; i < n; i++)
            for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k++) {
                const double own = k < 3 ? model.ttI[i] : model.rrI[i];
                const int row = rows * i + k;
                velocities(particles.firstRow[i] + k, c) = weights[i] *
                                                           (scale / (k < 3 ? 1 : length)) *
                                                           (sums(row, c) + own * loads(row, c));
            }
    return true;
}

}  // namespace RigidHIPlugin
