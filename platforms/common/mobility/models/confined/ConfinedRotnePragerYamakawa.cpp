#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "linearalgebra/SymmetricProduct.h"
#include "mobility/models/confined/PlaneModes.h"
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

/** Modes that reach the particle nearest to a wall with less than this part are left out. */
const double smallestMode = 1e-16;

/** k z at which (1 + 2kz)^2 exp(-2kz) is the smallest mode. */
double largestDepth() {
    double x = 1;
    for (int n = 0; n < 50; n++) x = 0.5 * (2 * std::log1p(2 * x) - std::log(smallestMode));
    return x;
}

/** A flow of rank 1 that M contains with a sign: all particles feel it, and it is weighed alike by
 * their forces. */
struct SignedMode {
    FeltMode felt;
    double factor;
};

/**
 * The flows of one wave vector that the walls subtract, times the viscosity and the area: M -= sum
 * of factor u u^T.
 */
class WallModes {
public:
    WallModes(const ConfiningPlanes& planes, double period, double middle)
        : height(planes.isChannel() ? planes.getHeight() : 0), period(period), middle(middle) {}
    int count(bool withImages) const { return height > 0 ? 3 : withImages ? 9 : 3; }
    /** @param z  over the lower wall */
    void fill(double k, bool withImages, double z, double a, SignedMode* modes) const {
        if (height > 0)
            betweenWalls(k, z, a, modes);
        else {
            aboveWall(k, z, a, modes);
            if (withImages) ofImages(k, z, a, modes + 3);
        }
    }

private:
    void betweenWalls(double k, double z, double a, SignedMode* modes) const {
        const PeriodicPlaneFlow onPlane(k, height, 0), flow(k, height, z);
        modes[0] = {flow.fromL(a), 1 / onPlane.ll()};
        modes[1] = {flow.fromT(a), 1 / onPlane.tt()};
        modes[2] = {flow.fromZ(a), 1 / onPlane.zz()};
    }
    static void aboveWall(double k, double z, double a, SignedMode* modes) {
        const double e = std::exp(-k * z), kz = k * z, k2 = k * k;
        const PlaneFunction plain = {e, -k * e, 0, 0},
                            rising = {(1 + 2 * kz) * e, k * (1 - 2 * kz) * e, -4 * k2 * e,
                                      4 * k2 * k * e};
        modes[0] = {FeltMode::ofAcross(plain, k, a), 1 / (8 * k)};
        modes[1] = {FeltMode::ofAcross(rising, k, a), 1 / (8 * k)};
        modes[2] = {FeltMode::ofAlongT(plain, k, a), 1 / (2 * k)};
    }
    /**
     * The images of period P of the free flow,
     *     2 cosh(k zeta) q/(1 - q) + k (2P cosh(k zeta) q/(1 - q)^2 - 2 zeta sinh(k zeta) q/(1-q))
     * over 4k, q = exp(-kP), and along t 2 cosh(k zeta) q/(1 - q) over 2k. Products of two
     * functions are differences of squares.
     */
    void ofImages(double k, double z, double a, SignedMode* modes) const {
        const double x = k * (z - middle), half = 0.5 * k * period, k2 = k * k;
        // exp(+-x) and x exp(+-x), times the root of q
        const double u = std::exp(x - half), d = std::exp(-x - half);
        const PlaneFunction up = {u, k * u, 0, 0}, down = {d, -k * d, 0, 0},
                            xUp = {x * u, k * (1 + x) * u, 2 * k2 * u, 2 * k2 * k * u},
                            xDown = {x * d, k * (1 - x) * d, -2 * k2 * d, 2 * k2 * k * d};
        const double rest = -std::expm1(-k * period), weight = 0.5 / (4 * k * rest);
        const PlaneFunction partner = down * (1 + k * period / rest) + xDown;
        modes[0] = {FeltMode::ofAcross(up + partner, k, a), weight};
        modes[1] = {FeltMode::ofAcross(up - partner, k, a), -weight};
        modes[2] = {FeltMode::ofAcross(xUp - down, k, a), weight};
        modes[3] = {FeltMode::ofAcross(xUp + down, k, a), -weight};
        modes[4] = {FeltMode::ofAlongT(up + down, k, a), 2 * weight};
        modes[5] = {FeltMode::ofAlongT(up - down, k, a), -2 * weight};
    }

    const double height, period, middle;
};

/**
 * What the walls add to the flow along them that does not depend on x and y, times the viscosity
 * and the area: of velocities and angular velocities about the axis across (W_y for x, -W_x for y),
 * of a particle of radius a_i at z_i because of force and torque on one at z_j.
 */
Eigen::Matrix2d uniformPart(const ConfiningPlanes& planes, double period, double z_i, double a_i,
                            double z_j, double a_j) {
    Eigen::Matrix2d part;
    if (planes.isChannel()) {
        const double H = planes.getHeight();
        const auto felt = [&](double z, double a) {
            return Eigen::Vector2d(z * (H - z) - a * a / 3, 0.5 * (H - 2 * z));
        };
        // Of the plane at rest, u u'/S with u = H/12 - p/2H, S = H/12, there is no net flux.
        const auto ofPlane = [&](double z, double a) -> Eigen::Vector2d {
            return Eigen::Vector2d(H / 12, 0) - felt(z, a) / (2 * H);
        };
        part = -12 / H * ofPlane(z_i, a_i) * ofPlane(z_j, a_j).transpose();
        if (!planes.hasZeroFlux())
            part += 3 / (H * H * H) * felt(z_i, a_i) * felt(z_j, a_j).transpose();
        return part;
    }
    // (z + z')/2 - (P/12 + zeta^2/2P): in place of the periodic flow, min(z, z')
    const double zeta = z_i - z_j;
    part(0, 0) = 0.5 * (z_i + z_j) - period / 12 -
                 (zeta * zeta + (a_i * a_i + a_j * a_j) / 3) / (2 * period);
    part(1, 0) = 0.25 - zeta / (2 * period);
    part(0, 1) = 0.25 + zeta / (2 * period);
    part(1, 1) = 0.25 / period;
    return part;
}

class ConfinedAt : public MobilityAt {
public:
    explicit ConfinedAt(const ConfinedRotnePragerYamakawa& model)
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
    std::vector<Vec3> positions;  // over the lower wall, lifted to contact
    VectorXd weights;             // B, for each row; empty: no particle reaches through a wall
    BoxVectors box = {}, base = {};
    double period = 0, middle = 0, leastDepth = 0, span = 0;
    MatrixXd cached;
    bool isKnown = false;
    // Particles by increasing distance from the nearer wall, and their rows.
    std::vector<int> order, firstSorted;
    std::vector<double> depths;
    MatrixXd positive, negative;  // columns of the present waves, with sorted rows
};

void ConfinedAt::moveTo(const Placement& placement, bool nearby) {
    planes.checkBox(placement.box);
    box = placement.box;
    positions = placement.positions;
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
        positions[i][2] -= planes.getLow();
    }
    setPeriod();
    isKnown = false;
}

/**
 * The period of the base. Above a wall, images of the period have few modes if the period is longer
 * than the layer of particles by the width of the box. The period is a multiple of a step, so that
 * it rarely changes.
 */
void ConfinedAt::setPeriod() {
    double lowest = INFINITY, highest = -INFINITY;
    leastDepth = INFINITY;
    for (const Vec3& x : positions) {
        lowest = std::min(lowest, x[2]);
        highest = std::max(highest, x[2]);
        leastDepth = std::min(
            leastDepth, planes.isChannel() ? std::min(x[2], planes.getHeight() - x[2]) : x[2]);
    }
    span = highest - lowest;
    if (planes.isChannel())
        period = planes.getHeight();
    else {
        const double width = std::max(std::sqrt(planeArea(box)),
                                      0.5 * std::max(box[0][0], std::hypot(box[1][0], box[1][1]))),
                     step = 0.5 * width;
        period = width + step * std::ceil(span / step);
    }
    middle = 0.5 * (lowest + highest);
    base = {box[0], box[1], Vec3(0, 0, period)};
    sum.setBox(base);
}

void ConfinedAt::sortByDepth() {
    const int n = particles.size();
    depths.resize(n);
    for (int i = 0; i < n; i++)
        depths[i] = planes.isChannel()
                        ? std::min(positions[i][2], planes.getHeight() - positions[i][2])
                        : positions[i][2];
    order.resize(n);
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](int i, int j) { return depths[i] < depths[j]; });
    firstSorted.assign(1, 0);
    for (int i : order) firstSorted.push_back(firstSorted.back() + rowsOf(i));
}

/** Fill the columns of the present waves for the particles that feel them, which come first. */
void ConfinedAt::fillColumns(const PlaneWave* waves, int size, int numModes, bool withImages) {
    const WallModes walls(planes, period, middle);
    int toPositive = 0, toNegative = 0;
    SignedMode modes[9];
    const double scale = 8 * M_PI * 2 / planeArea(box);  // both k and -k
    for (int w = 0; w < size; w++) {
        const PlaneWave& wave = waves[w];
        for (int s = 0; s < positive.rows() && firstSorted[s] < positive.rows(); s++) {
            const int i = order[s], row = firstSorted[s];
            walls.fill(wave.length, withImages, positions[i][2], radius(i), modes);
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

/** Subtract the modes of the walls from the matrix with sorted rows, whose lower triangle counts.
 */
void ConfinedAt::addModes(MatrixXd& sorted) {
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
        // Pairs feel a wave if the sum of both distances from walls allows it.
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

void ConfinedAt::addUniformPart() {
    const double scale = 8 * M_PI / planeArea(box);
    for (int j = 0; j < particles.size(); j++)
        for (int i = 0; i < particles.size(); i++) {
            const Eigen::Matrix2d part = scale * uniformPart(planes, period, positions[i][2],
                                                             radius(i), positions[j][2], radius(j));
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

const MatrixXd& ConfinedAt::matrix() {
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

void ConfinedAt::addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points,
                           double factor, Velocities& velocities) {
    FlowSources weighted = sources;
    if (weights.size() > 0) weighted.forces = weights.asDiagonal() * sources.forces;
    std::vector<Vec3> over = points;
    double highest = -INFINITY, lowest = INFINITY;
    for (Vec3& point : over) {
        point[2] -= planes.getLow();
        lowest = std::min(lowest, point[2]);
        highest = std::max(highest, point[2]);
    }
    if (over.empty()) return;
    LatticeSum flow(particles, overSurfaces(), false, true);
    double basePeriod = period, centre = middle, reach = span;
    if (!planes.isChannel()) {
        // Points may be higher or lower than all particles.
        const double top = std::max(highest, middle + 0.5 * span),
                     bottom = std::min(lowest, middle - 0.5 * span);
        reach = top - bottom;
        centre = 0.5 * (top + bottom);
        basePeriod = reach + period - span;
    }
    flow.setBox({box[0], box[1], Vec3(0, 0, basePeriod)});
    flow.addFlowAt(positions, weighted, over, factor / (8 * M_PI * viscosity), velocities);

    const double scale = factor / (viscosity * planeArea(box)), depth = largestDepth(),
                 imagesEnd = planes.isChannel() ? 0 : 2 * depth / (basePeriod - reach);
    const WallModes walls(planes, basePeriod, centre);
    SignedMode modes[9];
    const auto forceOn = [&](int j) {
        return Vector3d(weighted.forces.col(0).segment<3>(particles.firstRow[j]));
    };
    const auto torqueOn = [&](int j) {
        return Vector3d(weighted.forces.col(0).segment<3>(particles.firstRow[j] + 3));
    };
    // Points may be on a wall, so that the modes end with the depths of particles alone.
    for (const PlaneWave& wave : planeWaves(box, std::max(2 * depth / leastDepth, imagesEnd))) {
        const bool withImages = wave.length < imagesEnd;
        const int numModes = walls.count(withImages);
        complex<double> sums[9] = {};
        for (int j = 0; j < particles.size(); j++) {
            walls.fill(wave.length, withImages, positions[j][2], radius(j), modes);
            const complex<double> phase =
                std::polar(1.0, -wave.k[0] * positions[j][0] - wave.k[1] * positions[j][1]);
            for (int m = 0; m < numModes; m++) {
                complex<double> power = modes[m].felt.velocity(wave).dot(forceOn(j));
                if (particles.hasTorque[j]) power += modes[m].felt.omega(wave).dot(torqueOn(j));
                sums[m] += phase * power;
            }
        }
        for (size_t p = 0; p < over.size(); p++) {
            walls.fill(wave.length, withImages, over[p][2], 0, modes);
            const complex<double> phase =
                std::polar(1.0, wave.k[0] * over[p][0] + wave.k[1] * over[p][1]);
            for (int m = 0; m < numModes; m++)
                velocities.col(p) -= (2 * scale * modes[m].factor) *
                                     (phase * sums[m] * modes[m].felt.velocity(wave)).real();
        }
    }
    for (size_t p = 0; p < over.size(); p++)
        for (int j = 0; j < particles.size(); j++) {
            const Eigen::Matrix2d part =
                uniformPart(planes, basePeriod, over[p][2], 0, positions[j][2], radius(j));
            for (int axis = 0; axis < 2; axis++) {
                velocities(axis, p) += scale * part(0, 0) * forceOn(j)[axis];
                if (particles.hasTorque[j])
                    velocities(axis, p) +=
                        (axis == 0 ? 1 : -1) * scale * part(0, 1) * torqueOn(j)[1 - axis];
            }
        }
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
    checkPeriodicRows(particles.numRows, mostLatticeRows, false);
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
    return std::make_unique<ConfinedAt>(*this);
}

}  // namespace RigidHIPlugin
