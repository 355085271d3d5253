#include "mobility/models/forcecoupling/GridShape.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "linearalgebra/Decompositions.h"
#include "mobility/models/forcecoupling/Envelopes.h"

namespace RigidHIPlugin {

double GridShape::waveNumber(int axis, int index) const {
    return 2 * M_PI / edge[axis] * waveIndex(axis, index);
}

BoxVectors vectorsNearTo(const BoxVectors& other, BoxVectors box) {
    for (int k = 1; k < 3; k++)
        for (int axis = k - 1; axis >= 0; axis--)
            box[k] += box[axis] * std::round((other[k][axis] - box[k][axis]) / box[axis][axis]);
    return box;
}

GridLean::GridLean(const BoxVectors& box) {
    const double tilts[3] = {box[1][0], box[2][0], box[2][1]},
                 edges[3] = {box[0][0], box[0][0], box[1][1]};
    const int number = (tilts[0] != 0) + (tilts[1] != 0) + (tilts[2] != 0);
    if (number == 0) return;
    const auto tilt = [&](int i) {
        return number == 1 && tilts[i] != 0 ? std::max(0.5 * edges[i], std::abs(tilts[i]))
                                            : tilts[i];
    };
    const BoxVectors farthest = {OpenMM::Vec3(box[0][0], 0, 0), OpenMM::Vec3(tilt(0), box[1][1], 0),
                                 OpenMM::Vec3(tilt(1), tilt(2), box[2][2])};
    for (int axis = 0; axis < 3; axis++)
        stretch[axis] = std::sqrt(farthest[axis].dot(farthest[axis])) / box[axis][axis];
    const Eigen::Matrix3d T = GridSkew(farthest).matrix();  // k = T^T k'
    squares = 1 / Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(Eigen::Matrix3d(T * T.transpose()),
                                                                 Eigen::EigenvaluesOnly)
                      .eigenvalues()[0];
}

bool GridLean::isShared(const BoxVectors& one, const BoxVectors& other) {
    for (int i = 0; i < 3; i++)
        if (one[i][i] != other[i][i]) return false;
    const GridLean a(one), b(other);
    return a.stretch == b.stretch && a.squares == b.squares;
}

std::array<int, 3> GridShape::indicesOf(const std::array<double, 3>& k) const {
    // k' is the inverse of T^T times k.
    const double y = k[1] - skew.xy * k[0];
    const double ofGrid[3] = {k[0], y, k[2] - (skew.yz * y + skew.xz * k[0])};
    std::array<int, 3> n;
    for (int axis = 0; axis < 3; axis++)
        n[axis] = std::lround(ofGrid[axis] * edge[axis] / (2 * M_PI));
    return n;
}

bool GridShape::carries(const std::array<double, 3>& k) const {
    const std::array<int, 3> n = indicesOf(k);
    for (int axis = 0; axis < 3; axis++)
        if (2 * std::abs(n[axis]) >= size[axis]) return false;
    return skew.isNone() || std::sqrt(k[0] * k[0] + k[1] * k[1] + k[2] * k[2]) <= longestWave();
}

double GridShape::longestWave() const {
    // |k'_i| = |k.a_i|/edge_i for the vector a_i of the box.
    double longest = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; axis++) {
        OpenMM::Vec3 vector;
        vector[axis] = edge[axis];
        vector = skew.fromGrid(vector);
        longest = std::min(longest, M_PI * size[axis] / std::sqrt(vector.dot(vector)));
    }
    return longest;
}

static int nextSize(int first) {
    for (int n = first;; n += 2) {
        int rest = n;
        for (int factor : {2, 3, 5, 7})
            while (rest % factor == 0) rest /= factor;
        if (rest == 1) return n;
    }
}

int nextGridSize(double least) {
    if (!(least <= tooManyNodes)) return tooManyNodes;
    return nextSize(std::max(2, 2 * (int)std::ceil(least / 2 - 1e-9)));
}

int nextOddGridSize(double least) {
    if (!(least <= tooManyNodes)) return tooManyNodes;
    return nextSize(std::max(3, 2 * (int)std::ceil((least - 1) / 2 - 1e-9) + 1));
}

GridResolution::GridResolution(const HydrodynamicParticles& particles, double wanted,
                               double givenSpacing)
    : spacing(givenSpacing), tolerance(wanted) {
    // For every pair, a grid loses a part exp(-(pi width/spacing)^2) of a Gaussian of this width.
    // Curls of the narrower torque envelopes lose a factor k more. Measurements show that the
    // factors `finer` and `wider` keep the error below the tolerance (docs/grid_accuracy.md).
    narrowest = std::numeric_limits<double>::infinity();
    bool torques = false;
    for (int i = 0; i < particles.size(); i++) {
        narrowest =
            std::min(narrowest, particles.hasTorque[i] ? torqueEnvelopeWidth(particles.radii[i])
                                                       : forceEnvelopeWidth(particles.radii[i]));
        torques = torques || particles.hasTorque[i];
    }
    const double finer = torques ? 9 : 2, wider = torques ? 30 : 2;
    if (spacing > 0) {
        const double x = M_PI * narrowest / spacing;
        tolerance = std::max(smallestTolerance, finer * std::exp(-x * x));
    } else {
        spacing = M_PI * narrowest / std::sqrt(std::log(finer / tolerance));
    }
    // Near planes products have errors up to 0.3 of the part that an envelope loses there; without
    // torques up to 0.1, and 0.2 at coarse tolerances. Errors of nodes along the planes come on
    // top.
    const double lost =
        torques ? 1.4 * tolerance : std::min(10 * tolerance, std::max(0.04, tolerance));
    spacingAcross =
        std::min(spacing, M_PI * narrowest / std::sqrt(-2 * std::log(std::min(0.9, lost))));
    coarsest = M_PI * narrowest / std::sqrt(std::log(finer / largestTolerance));
    cutoffInWidths = std::sqrt(2 * std::log(2 * wider / tolerance));
}

double GridResolution::cutoff(double radius) const {
    return cutoffInWidths * forceEnvelopeWidth(radius);
}

GridShape GridResolution::shapeFor(const BoxVectors& box) const {
    // On a grid with the largest wave number K = pi/h, the waves k' and 2 K - k' alias. With a
    // Gaussian of the width w = width sqrt(u) and the factors of modes, the error of a wave k' is
    // exp(-width^2 k^2 - 2 w^2 K (K - k')). With k >= k'/stretch it is at most exp(-width^2 K^2 (2u
    // - u^2 stretch^2)).
    const GridLean lean(box);
    const double u = 1 / lean.squares;
    GridShape shape;
    shape.skew = GridSkew(box);
    for (int axis = 0; axis < 3; axis++) {
        const double s = lean.stretch[axis];
        shape.edge[axis] = box[axis][axis];
        shape.size[axis] =
            nextGridSize(shape.edge[axis] / (spacing * std::sqrt(2 * u - u * u * s * s)));
    }
    return shape;
}

GridShape GridResolution::shapeBetweenPlanes(const BoxVectors& box) const {
    GridShape shape = shapeFor(box);
    shape.size[2] = nextGridSize(shape.edge[2] / spacingAcross);
    return shape;
}

}  // namespace RigidHIPlugin
