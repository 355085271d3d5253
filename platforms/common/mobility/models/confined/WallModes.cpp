#include "mobility/models/confined/WallModes.h"

#include <algorithm>
#include <cmath>

#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

using Eigen::Vector3d;
using OpenMM::Vec3;
using std::complex;

double depthOfModes(double size) {
    double x = 1;
    for (int n = 0; n < 50; n++) x = 0.5 * (2 * std::log1p(2 * x) - std::log(size));
    return x;
}

double largestDepth() {
    static const double depth = depthOfModes(1e-16);
    return depth;
}

void WallModes::fill(double k, bool withImages, double z, double a, SignedMode* modes) const {
    if (height > 0) {
        betweenWalls(k, z, a, modes);
        return;
    }
    const double e = std::exp(-k * z), kz = k * z, k2 = k * k;
    const PlaneFunction plain = {e, -k * e, 0, 0}, rising = {(1 + 2 * kz) * e, k * (1 - 2 * kz) * e,
                                                             -4 * k2 * e, 4 * k2 * k * e};
    modes[0] = {FeltMode::ofAcross(plain, k, a), 1 / (8 * k)};
    modes[1] = {FeltMode::ofAcross(rising, k, a), 1 / (8 * k)};
    modes[2] = {FeltMode::ofAlongT(plain, k, a), 1 / (2 * k)};
    if (withImages) ofImages(k, z, a, modes + 3);
}

void WallModes::betweenWalls(double k, double z, double a, SignedMode* modes) const {
    const PeriodicPlane<double> onPlane(k, height, 0), flow(k, height, z);
    modes[0] = {feltFromL(flow, k, a), 1 / onPlane.ll};
    modes[1] = {feltFromT(flow, k, a), 1 / onPlane.tt};
    modes[2] = {feltFromZ(flow, k, a), 1 / onPlane.zz};
}

/**
 * The images of period P of the free flow,
 *     2 cosh(k zeta) q/(1 - q) + k (2P cosh(k zeta) q/(1 - q)^2 - 2 zeta sinh(k zeta) q/(1 - q))
 * over 4k, q = exp(-kP), and along t 2 cosh(k zeta) q/(1 - q) over 2k. Products of two functions
 * are written as differences of squares.
 */
void WallModes::ofImages(double k, double z, double a, SignedMode* modes) const {
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

UniformFlow::UniformFlow(const ConfiningPlanes& planes, double period) {
    // coefficients for 1, z and z^2
    coefficients << -period / 12, 0.5, -0.5 / period,  //
        0.5, 1 / period, 0,                            //
        -0.5 / period, 0, 0;
    if (!planes.isChannel()) return;
    const double H = planes.getHeight();
    coefficients(1, 1) -= 1 / H;
    if (planes.hasZeroFlux())
        coefficients.bottomRightCorner<2, 2>() -=
            3 / H * (Eigen::Matrix2d() << 1, -1 / H, -1 / H, 1 / (H * H)).finished();
}

double basePeriod(const ConfiningPlanes& planes, const BoxVectors& box, double span) {
    if (planes.isChannel()) return planes.getHeight();
    const double width = std::max(std::sqrt(planeArea(box)),
                                  0.5 * std::max(box[0][0], std::hypot(box[1][0], box[1][1]))),
                 step = 0.5 * width;
    return width + step * std::ceil(span / step);
}

void addConfinedFlow(const ConfiningPlanes& planes, const HydrodynamicParticles& particles,
                     const std::vector<Vec3>& positions, const BoxVectors& box,
                     const Eigen::MatrixXd& forces, const std::vector<Vec3>& points, double factor,
                     Velocities& velocities) {
    if (points.empty() || positions.empty()) return;
    std::vector<double> ofParticles, ofPoints;  // heights
    double leastDepth = INFINITY, lowest = INFINITY, highest = -INFINITY;
    for (const Vec3& x : positions) {
        ofParticles.push_back(x[2] - planes.getLow());
        leastDepth = std::min(leastDepth, planes.depth(x[2]));
    }
    for (const Vec3& x : points) ofPoints.push_back(x[2] - planes.getLow());
    for (const std::vector<double>& heights : {ofParticles, ofPoints})
        for (double z : heights) {
            lowest = std::min(lowest, z);
            highest = std::max(highest, z);
        }
    const double span = highest - lowest, period = basePeriod(planes, box, span);
    LatticeSum inBase(particles, overSurfaces(), false, true);
    inBase.setBox({box[0], box[1], Vec3(0, 0, period)});
    inBase.addFlowAt(positions, {forces, {}}, points, factor / (8 * M_PI), velocities);

    const double scale = factor / planeArea(box), depth = largestDepth(),
                 imagesEnd = planes.isChannel() ? 0 : 2 * depth / (period - span);
    const WallModes walls(planes, period, 0.5 * (lowest + highest));
    SignedMode modes[WallModes::most];
    const auto part = [&](int j, int first) {
        return Vector3d(forces.col(0).segment<3>(particles.firstRow[j] + first));
    };
    // Points may be on a wall, so only the depths of particles determine the cut-off of modes.
    for (const PlaneWave& wave : planeWaves(box, std::max(2 * depth / leastDepth, imagesEnd))) {
        const bool withImages = wave.length < imagesEnd;
        const int numModes = walls.count(withImages);
        complex<double> sums[WallModes::most] = {};
        for (int j = 0; j < particles.size(); j++) {
            walls.fill(wave.length, withImages, ofParticles[j], particles.radii[j], modes);
            const complex<double> phase =
                std::polar(1.0, -wave.k[0] * positions[j][0] - wave.k[1] * positions[j][1]);
            for (int m = 0; m < numModes; m++) {
                complex<double> power = modes[m].felt.velocity(wave).dot(part(j, 0));
                if (particles.hasTorque[j]) power += modes[m].felt.omega(wave).dot(part(j, 3));
                sums[m] += phase * power;
            }
        }
        for (size_t p = 0; p < points.size(); p++) {
            walls.fill(wave.length, withImages, ofPoints[p], 0, modes);
            const complex<double> phase =
                std::polar(1.0, wave.k[0] * points[p][0] + wave.k[1] * points[p][1]);
            for (int m = 0; m < numModes; m++)
                velocities.col(p) -= (2 * scale * modes[m].factor) *
                                     (phase * sums[m] * modes[m].felt.velocity(wave)).real();
        }
    }
    const UniformFlow uniform(planes, period);
    for (size_t p = 0; p < points.size(); p++)
        for (int j = 0; j < particles.size(); j++) {
            const Eigen::Matrix2d of =
                scale * uniform.between(ofPoints[p], 0, ofParticles[j], particles.radii[j]);
            for (int axis = 0; axis < 2; axis++) {
                velocities(axis, p) += of(0, 0) * part(j, 0)[axis];
                if (particles.hasTorque[j])
                    velocities(axis, p) += (axis == 0 ? 1 : -1) * of(0, 1) * part(j, 3)[1 - axis];
            }
        }
}

}  // namespace RigidHIPlugin
