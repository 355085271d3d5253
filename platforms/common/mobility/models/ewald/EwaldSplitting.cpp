#include "mobility/models/ewald/EwaldSplitting.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "mobility/models/ewald/NearPair.h"
#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

namespace {

/**
 * Shares of the tolerance. Measurements show that they keep the error below it
 * (docs/grid_accuracy.md).
 */
const double shareOfWaves = 0.4, shareOfPairs = 0.4, shareOfGrid = 0.15;
/**
 * The share with dipoles: slopes of a Gaussian contain more of the waves that alias on the grid.
 */
const double shareOfGridWithDipoles = 0.03;

/** Times in ns on one thread, measured (benchmarks/README.md). */
const double timeOfTransform =
    0.16;  // for each node, each doubling of the number of nodes, and each of six transforms
const double timeOfMode = 1;    // for each node: the response of the fluid
const double timeOfNode = 1.2;  // for each node of a stencil, spreading and averaging
const double timeOfPair = 5, timeOfTorquePair = 12,
             timeOfStressletPair = 30;  // for each pair, in one direction, with its share of the
                                        // time for the list

/**
 * The smallest wave number beyond which waves add at most `allowed` to the own mobility of a
 * particle.
 */
double largestWave(const std::vector<EwaldKind>& kinds, double xi, double allowed) {
    // H is 1e-19 at `end`.
    const double end = 2 * xi * 7, step = 0.02 * xi;
    std::vector<double> ofForces(kinds.size(), 0), ofTorques(kinds.size(), 0);
    for (double k = end; k > step; k -= step) {
        const double h = hasimoto(k, xi);
        for (size_t a = 0; a < kinds.size(); a++) {
            const double radius = kinds[a].radius;
            const WaveFactors f = overSurfaces().waveFactors(radius, k);
            ofForces[a] += step * 2 * radius / M_PI * f.s * f.s * h;
            if (kinds[a].torques > 0)
                ofTorques[a] +=
                    step * 2 * radius * radius * radius / (3 * M_PI) * k * k * f.t * f.t * h;
            if (std::max(ofForces[a], ofTorques[a]) > allowed) return k;
        }
    }
    return step;
}

/** The smallest gap beyond which pairs add at most `allowed`, for particles at this density. */
double largestGap(const std::vector<EwaldKind>& kinds, double xi, double density, double allowed) {
    double largest = 0;
    const EwaldKind* const ends[] = {&kinds.front(), &kinds.back()};
    for (int i = 0; i < 2; i++)
        for (int j = i; j < 2; j++) {
            const double a = ends[i]->radius, b = ends[j]->radius;
            if ((i > 0 || j > 0) && kinds.size() == 1) continue;
            const bool torques = ends[i]->torques + ends[j]->torques > 0;
            const bool stresslets = ends[i]->stresslets;
            const NearPair pair(a, b, xi, torques, stresslets);
            const double ofForces = 0.75 * std::sqrt(a * b), ofTorques = std::pow(a * b, 1.5),
                         ofBoth = std::sqrt(0.75) * std::max(std::sqrt(a) * std::pow(b, 1.5),
                                                             std::sqrt(b) * std::pow(a, 1.5));
            const double step = 0.1 / xi;
            double sum = 0;
            for (double r = pair.getReach(); r > pair.getContact(); r -= step) {
                const PairFunctions f = pair.at(r);
                const double r2 = r * r;
                double most = ofForces * std::max(std::abs(f.ttI), std::abs(f.ttI + f.ttR * r2));
                if (torques)
                    most = std::max(
                        {most, ofBoth * r * std::max(std::abs(f.tr), std::abs(f.rt)),
                         ofTorques * std::max(std::abs(f.rrI), std::abs(f.rrI + f.rrR * r2))});
                if (stresslets) {
                    // Scaled by the roots of own mobilities: 5/6 a^3 for strain rates, 3/4 a for
                    // velocities.
                    const double ofStrains = 5.0 / 6 * ofTorques,
                                 withForces = std::sqrt(5.0 / 6) * ofBoth,
                                 withTorques = std::sqrt(5.0 / 6) * ofTorques;
                    most = std::max(
                        {most, withForces * r * std::max(std::abs(f.ts), std::abs(f.st)),
                         withForces * r *
                             std::max(std::abs(f.ts + f.tsR * r2), std::abs(f.st + f.stR * r2)),
                         withTorques * r2 * std::abs(f.rs), ofStrains * std::abs(f.ssI),
                         ofStrains * std::abs(f.ssI + 0.5 * f.ssV * r2),
                         ofStrains * std::abs(f.ssI + 2.0 / 3 * (f.ssV * r2 + f.ssR * r2 * r2))});
                }
                sum += step * 4 * M_PI * r2 * density * most;
                if (sum <= allowed) continue;
                largest = std::max(largest, r - pair.getContact());
                break;
            }
        }
    return largest;
}

/**
 * The own mobility of a particle over its free mobility. In a box of a few radii this part is
 * small, and so is the norm of the mobility of very few particles. In a cube it is 1 - 2.837 a/L +
 * (4 pi/3) (a/L)^3 (Hasimoto, J. Fluid Mech. 5, 317 (1959); 0.1 where the particle touches its
 * images). Errors relative to free mobilities must be smaller by this factor. With the shortest
 * edge L it is a lower bound.
 */
double partOfFreeMobility(double radius, const BoxVectors& box) {
    const double x = radius / std::min({box[0][0], box[1][1], box[2][2]});
    const double part = 1 - 2.837297 * x + 4 * M_PI / 3 * x * x * x;
    // From one half on, the errors are far enough below the tolerance. Bodies may overlap their
    // images.
    return part > 0.5 && x < 0.5 ? 1 : 0.9 * std::max(0.1, part);
}

/**
 * The images of walls are not split, so waves must carry them up to `longest`. If the waves of the
 * periodic part ended much earlier, the Gaussian would be wide on the scale of the images' waves.
 * The factor exp(k^2 w^2/2) would then amplify rounding and the truncated tails of the Gaussian.
 */
double leastXiOfWalls(double longest, double tolerance) {
    return longest / (2 * std::sqrt(std::log(1 / tolerance)));
}

/**
 * The reach of Gaussians beside walls, in widths. A wave k of a wall amplifies the truncated tail
 * of a Gaussian of width w, exp(-c^2/2w^2) beyond its end c, by exp(kc). The largest k of walls has
 * the weight tolerance/(1 + 2ka)^2, and kw is then about L, the root of ln(1/tolerance)
 * (leastXiOfWalls).
 */
double leastEndsOfWalls(double longest, double tolerance) {
    if (longest == 0) return 0;
    // In wall modes, (1 + 2ka)^2 exp(-2ka) = tolerance.
    const double square = std::log(1 / tolerance), L = std::sqrt(square);
    double depth = square;
    for (int n = 0; n < 20; n++) depth = 0.5 * (square + 2 * std::log1p(2 * depth));
    return L + std::sqrt(std::max(0.0, square - 4 * std::log1p(2 * depth))) + 0.7;
}

}  // namespace

std::vector<EwaldKind> kindsOf(const HydrodynamicParticles& particles, bool stresslets) {
    std::map<double, EwaldKind> byRadius;
    for (int i = 0; i < particles.size(); i++) {
        EwaldKind& kind =
            byRadius.insert({particles.radii[i], {particles.radii[i], 0, 0, stresslets}})
                .first->second;
        kind.particles++;
        kind.torques += particles.hasTorque[i] ? 1 : 0;
    }
    std::vector<EwaldKind> kinds;
    for (const auto& entry : byRadius) kinds.push_back(entry.second);
    return kinds;
}

EwaldSplitting::EwaldSplitting(const std::vector<EwaldKind>& kinds, double tolerance,
                               double spacing, const BoxVectors& box, double wantedXi,
                               double longestOfWalls) {
    const double volume = box[0][0] * box[1][1] * box[2][2],
                 longest = std::max({box[0][0], box[1][1], box[2][2]});
    int numParticles = 0, numChannels = 0, numPasses = 0;
    bool anyTorques = false;
    for (const EwaldKind& kind : kinds) {
        numParticles += kind.particles;
        numPasses += kind.particles + (kind.stresslets ? 2 : 1) * kind.torques;
        numChannels += kind.torques > 0 ? 2 : 1;
        anyTorques = anyTorques || kind.torques > 0;
    }
    const double smallest = kinds.front().radius, largest = kinds.back().radius;
    tolerance *= partOfFreeMobility(largest, box);
    const GridLean lean(box);
    // Crowded particles have more neighbours than the average.
    const double crowd = 0.1 / (4 * M_PI / 3 * largest * largest * largest),
                 density = std::max(numParticles / volume, crowd);
    const bool stresslets = haveStresslets(kinds);
    const double ofGrid = std::log(
                     1 / ((stresslets ? shareOfGridWithDipoles : shareOfGrid) * tolerance)),
                 ends =
                     std::max(std::sqrt(2 * ofGrid), leastEndsOfWalls(longestOfWalls, tolerance));
    seconds = std::numeric_limits<double>::infinity();
    const double ratio = 1.08, most = wantedXi > 0 ? wantedXi : 2.5 / smallest,
                 least = wantedXi > 0 ? wantedXi / ratio
                                      : std::max(std::min(0.05 / largest, 0.5 / longest),
                                                 leastXiOfWalls(longestOfWalls, tolerance));
    for (double x = most; x > least; x /= ratio) {
        const double coarsest =
            M_PI / std::max(longestOfWalls, largestWave(kinds, x, shareOfWaves * tolerance));
        double nearby = -1;
        for (double h = coarsest; h > 0.5 * coarsest; h *= 0.95) {
            GridShape grid;
            grid.skew = GridSkew(box);
            double widest = 0;
            for (int axis = 0; axis < 3; axis++) {
                grid.edge[axis] = box[axis][axis];
                const double size =
                    lean.stretch[axis] * grid.edge[axis] / (spacing > 0 ? spacing : h);
                // GridWalls needs an odd number of nodes.
                grid.size[axis] =
                    longestOfWalls > 0 && axis == 2 ? nextOddGridSize(size) : nextGridSize(size);
                widest = std::max(widest, lean.stretch[axis] * grid.spacing(axis));
            }
            if (widest > coarsest) break;  // the user's spacing is too coarse for this xi
            // The largest aliasing error is exp(-2 pi^2 w^2/h^2 (1 - 2 xi^2 w^2)). w is the
            // smallest width that keeps this error below its share.
            const double c = widest * widest * ofGrid / (2 * M_PI * M_PI), root = 1 - 8 * x * x * c;
            if (root >= 0) {
                const double w = std::sqrt((1 - std::sqrt(root)) / (4 * x * x)),
                             P = 2 * ends * w / widest;
                // Along a tilted edge the error is that of the width w stretch, and modes must not
                // amplify the truncated tails of a Gaussian: exp(w^2 k'^2/2) <= exp(k^2/8 xi^2).
                bool isNarrow = 4 * x * x * w * w * lean.squares <= 1 || lean.squares == 1;
                for (const double stretch : lean.stretch) {
                    const double w2 = w * w * stretch * stretch;
                    isNarrow = isNarrow && (stretch == 1 || w2 * (1 - 2 * x * x * w2) >= c);
                }
                if (!isNarrow) continue;
                const double nodes = grid.numNodes();
                double time =
                    numChannels * nodes * (6 * timeOfTransform * std::log2(nodes) + timeOfMode) +
                    numPasses * timeOfNode * M_PI / 4 * P * P * (P + 4);
                if (time < 1e9 * seconds) {
                    if (nearby < 0)
                        nearby = largestGap(kinds, x, density, shareOfPairs * tolerance);
                    const double range = nearby + 2 * largest,
                                 around =
                                     numParticles / volume * 4 * M_PI / 3 * range * range * range;
                    time += numParticles * around *
                            (stresslets   ? timeOfStressletPair
                             : anyTorques ? timeOfTorquePair
                                          : timeOfPair);
                    if (time < 1e9 * seconds) {
                        seconds = 1e-9 * time;
                        xi = x;
                        shape = grid;
                        width = w;
                        cutoff = ends * w;
                        gap = nearby;
                        neighbours = around;
                    }
                }
            }
            if (spacing > 0) break;
        }
    }
}

}  // namespace RigidHIPlugin
