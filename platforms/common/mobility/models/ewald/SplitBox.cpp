#include "mobility/models/ewald/SplitBox.h"

#include <algorithm>
#include <cmath>

#include "mobility/models/ewald/NearPair.h"
#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

namespace {

int numbersOfPair(const std::vector<EwaldKind>& kinds) {
    if (haveStresslets(kinds)) return NearTables::withStresslets;
    for (const EwaldKind& kind : kinds)
        if (kind.torques > 0) return 6;
    return 2;
}

}  // namespace

// Each particle may be a tenth of the spacing along each axis away from its anchor, so two
// particles may be farther apart than their anchors. Tables therefore have a margin. A sheared box
// keeps its tables.
SplitBox::SplitBox(const std::vector<EwaldKind>& kinds, const EwaldSplitting& splitting,
                   const BoxVectors& box, const SplitBox* before)
    : box(box), splitting(splitting),
      spacing(std::max(
          {splitting.shape.spacing(0), splitting.shape.spacing(1), splitting.shape.spacing(2)})),
      shared(before && before->splitting.xi == splitting.xi &&
                     before->splitting.gap == splitting.gap && before->spacing == spacing
                 ? before->shared
                 : std::make_shared<const NearTables>(kinds, numbersOfPair(kinds), splitting.xi,
                                                      splitting.gap, 0.4 * spacing)),
      tables(*shared), resolution(GridResolution::ofPoints(splitting.width, splitting.cutoff)) {
    const double w = splitting.width, xi = splitting.xi;
    for (const EwaldKind& kind : kinds)
        for (const bool ofTorques : {false, true}) {
            if (ofTorques && kind.torques == 0) continue;
            factors.push_back(
                std::make_unique<GridFactors>(splitting.shape, [&](double k, double ofGrid) {
                    const WaveFactors f = overSurfaces().waveFactors(kind.radius, k);
                    // One exponential combines the Gaussian's factor and the square root of H,
                    // because each alone may overflow or underflow.
                    const double x = 0.25 * k * k / (xi * xi);
                    return (ofTorques ? f.t : f.s) * std::exp(0.5 * (w * w * ofGrid * ofGrid - x)) *
                           std::sqrt(1 + x) / k;
                }));
        }
}

}  // namespace RigidHIPlugin
