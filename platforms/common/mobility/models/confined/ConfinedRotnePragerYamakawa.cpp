#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "linearalgebra/SymmetricProduct.h"
#include "mobility/models/confined/WallModes.h"
#include "mobility/models/periodic/MostLatticeRows.h"
#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

using Eigen::MatrixXd;
using Eigen::Vector3cd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using OpenMM::Vec3;
using std::complex;

namespace {

class ConfinedRotnePragerYamakawaAt : public MobilityAt {
public:
    explicit ConfinedRotnePragerYamakawaAt(const ConfinedRotnePragerYamakawa& model)
        : MobilityAt(model), planes(model.getPlanes()), sum(particles, overSurfaces(), false) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override {
        velocities.noalias() = matrix() * forces;
    }
    void dense(MatrixXd& mobility) override { mobility = matrix(); }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override;

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    double radius(int i) const { return particles.radii[i]; }
    int rowsOf(int i) const { return particles.hasTorque[i] ? 6 : 3; }
    void setPeriod();
    const MatrixXd& matrix();
    void sortByDepth();
    void addModes(MatrixXd& sorted);
    void fillColumns(const PlaneWave* waves, int size, int numModes, bool withImages);
    void addUniformPart();

    const ConfiningPlanes& planes;
    LatticeSum sum;
    std::vector<Vec3> positions;  // lifted to contact
    std::vector<double> heights;  // above the lower wall
    VectorXd weights;             // B for each row; empty if no particle reaches through a wall
    BoxVectors box = {};
    double period = 0, middle = 0, leastDepth = 0, span = 0;
    MatrixXd cached;
    bool isKnown = false;
    // Particles by increasing distance from the nearer wall, and their rows.
    std::vector<int> order, firstSorted;
    std::vector<double> depths;
    MatrixXd positive, negative;  // columns of the present waves, with sorted rows
};

void ConfinedRotnePragerYamakawaAt::moveTo(const Placement& placement, bool nearby) {
    planes.checkBox(placement.box);
    box = placement.box;
    positions = placement.positions;
    heights.resize(particles.size());
    weights.resize(0);
    for (int i = 0; i < particles.size(); i++) {
        const double z = positions[i][2];
        if (!nearby) {
            positions[i] = planes.placeInFormulas(positions[i], radius(i));
            const double weight = planes.allowsCrossing() ? planes.weight(z, radius(i)) : 1;
            if (weight < 1) {
                if (weights.size() == 0) weights.setOnes(particles.numRows);
                weights.segment(particles.firstRow[i], rowsOf(i)).setConstant(weight);
            }
        }
        heights[i] = positions[i][2] - planes.getLow();
    }
    setPeriod();
    isKnown = false;
}

void ConfinedRotnePragerYamakawaAt::setPeriod() {
    leastDepth = INFINITY;
    for (const Vec3& x : positions) leastDepth = std::min(leastDepth, planes.depth(x[2]));
    const auto [lowest, highest] = std::minmax_element(heights.begin(), heights.end());
    span = *highest - *lowest;
    middle = 0.5 * (*lowest + *highest);
    period = basePeriod(planes, box, span);
    sum.setBox({box[0], box[1], Vec3(0, 0, period)});
}

void ConfinedRotnePragerYamakawaAt::sortByDepth() {
    const int n = particles.size();
    depths.resize(n);
    for (int i = 0; i < n; i++) depths[i] = planes.depth(positions[i][2]);
    order.resize(n);
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](int i, int j) { return depths[i] < depths[j]; });
    firstSorted.assign(1, 0);
    for (int i : order) firstSorted.push_back(firstSorted.back() + rowsOf(i));
}

/**
 * Fill the columns of the present waves for the particles that feel these waves. Those particles
 * come first.
 */
void ConfinedRotnePragerYamakawaAt::fillColumns(const PlaneWave* waves, int size, int numModes,
                                                bool withImages) {
    const WallModes walls(planes, period, middle);
    int toPositive = 0, toNegative = 0;
    SignedMode modes[WallModes::most];
    const double scale = 8 * M_PI * 2 / planeArea(box);  // both k and -k
    for (int w = 0; w < size; w++) {
        const PlaneWave& wave = waves[w];
        for (int s = 0; s < positive.rows() && firstSorted[s] < positive.rows(); s++) {
            const int i = order[s], row = firstSorted[s];
            walls.fill(wave.length, withImages, heights[i], radius(i), modes);
            const complex<double> phase =
                std::polar(1.0, wave.k[0] * positions[i][0] + wave.k[1] * positions[i][1]);
            int at[2] = {toPositive, toNegative};
            for (int m = 0; m < numModes; m++) {
                const complex<double> factor = phase * std::sqrt(scale * std::abs(modes[m].factor));
                const bool isNegative = modes[m].factor < 0;
                MatrixXd& columns = isNegative ? negative : positive;
                const int column = at[isNegative];
                at[isNegative] += 2;
                const Vector3cd V = factor * modes[m].felt.velocity(wave);
                columns.block<3, 1>(row, column) = V.real();
                columns.block<3, 1>(row, column + 1) = V.imag();
                if (!particles.hasTorque[i]) continue;
                const Vector3cd W = factor * modes[m].felt.omega(wave);
                columns.block<3, 1>(row + 3, column) = W.real();
                columns.block<3, 1>(row + 3, column + 1) = W.imag();
            }
        }
        toPositive += withImages && !planes.isChannel() ? 12 : 6;
        toNegative += withImages && !planes.isChannel() ? 6 : 0;
    }
}

/** Subtract the modes of the walls from the lower triangle of the matrix with sorted rows. */
void ConfinedRotnePragerYamakawaAt::addModes(MatrixXd& sorted) {
    const WallModes walls(planes, period, middle);
    const double depth = largestDepth();
    const double imagesEnd = planes.isChannel() ? 0 : 2 * depth / (period - span);
    const std::vector<PlaneWave> waves = planeWaves(box, std::max(depth / leastDepth, imagesEnd));
    const int numWaves = waves.size(), wavesAtOnce = 64;
    for (int first = 0; first < numWaves;) {
        const double k = waves[first].length;
        const bool withImages = k < imagesEnd;
        int size = 1;
        while (size < wavesAtOnce && first + size < numWaves &&
               (waves[first + size].length < imagesEnd) == withImages)
            size++;
        // A pair feels a wave only up to some sum of both distances from walls.
        int numActive = particles.size();
        if (!withImages)
            numActive = std::upper_bound(order.begin(), order.end(), 2 * depth / k - leastDepth,
                                         [&](double limit, int i) { return limit < depths[i]; }) -
                        order.begin();
        const int rows = firstSorted[numActive];
        const int numModes = walls.count(withImages),
                  numPositive = withImages && !planes.isChannel() ? 12 : 6;
        positive.resize(rows, numPositive * size);
        negative.resize(rows, (2 * numModes - numPositive) * size);
        fillColumns(&waves[first], size, numModes, withImages);
        MatrixXd part = MatrixXd::Zero(rows, rows);
        addProductOfRows(positive, positive.cols(), -1, part);
        if (negative.cols() > 0) addProductOfRows(negative, negative.cols(), 1, part);
        sorted.topLeftCorner(rows, rows) += part;
        first += size;
    }
}

void ConfinedRotnePragerYamakawaAt::addUniformPart() {
    const UniformFlow uniform(planes, period);
    const double scale = 8 * M_PI / planeArea(box);
    for (int j = 0; j < particles.size(); j++)
        for (int i = 0; i < particles.size(); i++) {
            const Eigen::Matrix2d part =
                scale * uniform.between(heights[i], radius(i), heights[j], radius(j));
            // V_x with W_y, and V_y with -W_x
            const int row = particles.firstRow[i], column = particles.firstRow[j];
            for (int axis = 0; axis < 2; axis++) {
                const double sign = axis == 0 ? 1 : -1;
                const int V = row + axis, W = row + 4 - axis, F = column + axis,
                          T = column + 4 - axis;
                cached(V, F) += part(0, 0);
                if (particles.hasTorque[i]) cached(W, F) += sign * part(1, 0);
                if (particles.hasTorque[j]) cached(V, T) += sign * part(0, 1);
                if (particles.hasTorque[i] && particles.hasTorque[j]) cached(W, T) += part(1, 1);
            }
        }
}

const MatrixXd& ConfinedRotnePragerYamakawaAt::matrix() {
    if (isKnown) return cached;
    sum.compute(positions, false, cached);
    sortByDepth();
    MatrixXd sorted = MatrixXd::Zero(particles.numRows, particles.numRows);
    addModes(sorted);
    mirrorLower(sorted);
    for (int s = 0; s < particles.size(); s++)
        for (int t = 0; t < particles.size(); t++)
            cached.block(particles.firstRow[order[s]], particles.firstRow[order[t]],
                         rowsOf(order[s]), rowsOf(order[t])) +=
                sorted.block(firstSorted[s], firstSorted[t], rowsOf(order[s]), rowsOf(order[t]));
    addUniformPart();
    cached *= 1 / (8 * M_PI * viscosity);
    if (weights.size() > 0) cached = weights.asDiagonal() * cached * weights.asDiagonal();
    mirrorLower(cached);
    isKnown = true;
    return cached;
}

void ConfinedRotnePragerYamakawaAt::addFlowAt(const FlowSources& sources,
                                              const std::vector<Vec3>& points, double factor,
                                              Velocities& velocities) {
    MatrixXd forces = sources.forces;
    if (weights.size() > 0) forces = weights.asDiagonal() * sources.forces;
    addConfinedFlow(planes, particles, positions, box, forces, points, factor / viscosity,
                    velocities);
}

MobilityTraits traitsBetween(const ConfiningPlanes& planes) {
    MobilityTraits traits("RotnePragerYamakawa");
    traits.mayObject = true;
    traits.holdsNearby = !planes.allowsCrossing();
    traits.hasProducts = false;
    return traits;
}

}  // namespace

ConfinedRotnePragerYamakawa::ConfinedRotnePragerYamakawa(const HydrodynamicParticles& particles,
                                                         double viscosity,
                                                         const ConfiningPlanes& planes)
    : MobilityModel(particles, viscosity, traitsBetween(planes)), planes(planes) {
    checkPeriodicRows(particles.numRows, mostLatticeRows);
    planes.checkRadii(particles);
}

bool ConfinedRotnePragerYamakawa::acceptsNearby(const Placement& placement) const {
    if (planes.allowsCrossing()) return objection(placement).empty();
    const double beyond = 0.01;  // of a radius: the matrix is still positive definite there
    return planes.areWithin(particles, placement, beyond);
}

WaveFactors ConfinedRotnePragerYamakawa::waveFactors(double radius, double k) const {
    return overSurfaces().waveFactors(radius, k);
}

double ConfinedRotnePragerYamakawa::volume(const BoxVectors& box) const {
    return planeArea(box) * planes.getHeight();
}

void ConfinedRotnePragerYamakawa::checkWave(const BoxVectors& box, int axis, int periods) const {
    checkPeriodicWave(box, axis, periods);
}

std::unique_ptr<MobilityAt> ConfinedRotnePragerYamakawa::makePlace() const {
    return std::make_unique<ConfinedRotnePragerYamakawaAt>(*this);
}

}  // namespace RigidHIPlugin
