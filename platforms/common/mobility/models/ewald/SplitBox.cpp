#include "mobility/models/ewald/SplitBox.h"

#include <algorithm>
#include <cmath>

#include "mobility/models/ewald/NearPair.h"
#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

namespace {

int numbersOfPair(const std::vector<EwaldKind>& kinds) {
    for (const EwaldKind& kind : kinds)
        if (kind.torques > 0) return 6;
    return 2;
}

}  // namespace

// Two particles may be farther apart than their anchors are, each by a tenth of the spacing along
// each axis. Tables therefore have a margin.
SplitBox::SplitBox(const std::vector<EwaldKind>& kinds, const EwaldSplitting& splitting,
                   const BoxVectors& box)
    : box(box), splitting(splitting),
      spacing(std::max(
          {splitting.shape.spacing(0), splitting.shape.spacing(1), splitting.shape.spacing(2)})),
      tables(kinds, numbersOfPair(kinds), splitting.xi, splitting.gap, 0.4 * spacing),
      resolution(GridResolution::ofPoints(splitting.width, splitting.cutoff)) {
    const double w = splitting.width, xi = splitting.xi;
    for (const EwaldKind& kind : kinds)
        for (const bool ofTorques : {false, true}) {
            if (ofTorques && kind.torques == 0) continue;
            factors.push_back(std::make_unique<GridFactors>(splitting.shape, [&](double k) {
                const WaveFactors f = overSurfaces().waveFactors(kind.radius, k);
                // The Gaussian's factor and the square root of H are multiplied in one exponential,
                // because each alone may be too large or too small for a number.
                const double x = 0.25 * k * k / (xi * xi);
                return (ofTorques ? f.t : f.s) * std::exp(0.5 * (w * w * k * k - x)) *
                       std::sqrt(1 + x) / k;
            }));
        }
}

}  // namespace RigidHIPlugin
