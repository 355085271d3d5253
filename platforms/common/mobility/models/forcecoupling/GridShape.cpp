#include "mobility/models/forcecoupling/GridShape.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "mobility/models/forcecoupling/Envelopes.h"

namespace RigidHIPlugin {

double GridShape::waveNumber(int axis, int index) const {
    return 2 * M_PI / edge[axis] * waveIndex(axis, index);
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
    // A grid leaves out a part exp(-(pi width/spacing)^2) of a Gaussian of this width, for every
    // pair. Curls of the narrower torque envelopes have a factor k more of it. Measurements show
    // that these factors keep the error below the tolerance (docs/grid_accuracy.md).
    double narrowest = std::numeric_limits<double>::infinity();
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
    // Errors that were measured near walls are at most a fifth of what this lets them be.
    const double ofPlanes = 0.1;
    spacingAcross = std::min(
        spacing, M_PI * narrowest / std::sqrt(2 * std::log(std::max(1.1, ofPlanes / tolerance))));
    coarsest = M_PI * narrowest / std::sqrt(std::log(finer / largestTolerance));
    cutoffInWidths = std::sqrt(2 * std::log(2 * wider / tolerance));
}

double GridResolution::cutoff(double radius) const {
    return cutoffInWidths * forceEnvelopeWidth(radius);
}

GridShape GridResolution::shapeFor(const BoxVectors& box) const {
    GridShape shape;
    for (int axis = 0; axis < 3; axis++) {
        shape.edge[axis] = box[axis][axis];
        shape.size[axis] = nextGridSize(shape.edge[axis] / spacing);
    }
    return shape;
}

GridShape GridResolution::shapeBetweenPlanes(const BoxVectors& box) const {
    GridShape shape = shapeFor(box);
    shape.size[2] = nextGridSize(shape.edge[2] / spacingAcross);
    return shape;
}

}  // namespace RigidHIPlugin
