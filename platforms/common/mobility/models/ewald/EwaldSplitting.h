#ifndef RIGIDHI_EWALD_SPLITTING_H_
#define RIGIDHI_EWALD_SPLITTING_H_

#include <vector>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/** Particles of one radius. */
struct EwaldKind {
    double radius;            // nm
    int particles, torques;   // their number, and the number with torques
    bool stresslets = false;  // whether all of them have torques and stresslets
};

/**
 * The kinds of particles, by radius.
 *
 * @param stresslets  whether all particles have stresslets; they then have torques, too
 */
std::vector<EwaldKind> kindsOf(const HydrodynamicParticles& particles, bool stresslets = false);
/** Whether particles have stresslets. All kinds have them, or none has. */
inline bool haveStresslets(const std::vector<EwaldKind>& kinds) {
    return !kinds.empty() && kinds.front().stresslets;
}

/**
 * The splitting of the periodic Rotne-Prager-Yamakawa mobility into pairs and waves, and the
 * cut-offs of both parts.
 *
 * Method:    The fastest splitting, by a model of the time, among all splittings with errors below
 *            the tolerance. The constants of this model were measured once. The choice uses no
 *            clock, so the splitting is a function of box, particles and settings.
 * Errors:    All errors are relative to own mobilities. The error of neglected waves is their sum
 *            for one particle. The error of pairs beyond the reach is their sum over a uniform
 *            density. The grid adds the errors of aliasing and of the truncated tails of the
 *            Gaussians.
 * Reference: Lindbo, Tornberg, J. Comput. Phys. 230, 8744 (2011), for the errors of the grid.
 */
struct EwaldSplitting {
    /**
     * @param tolerance  of products: the norm of their error over the norm of the mobility, both
     *     scaled by the square roots of own mobilities
     * @param spacing  the largest spacing of the grid, nm; 0 for the fastest
     * @param box  A box tilted along one axis gets the splitting of the box tilted by half an edge
     *     (GridLean), so that a box has one splitting while it is sheared.
     * @param wantedXi  for tests and benchmarks: this xi, 1/nm; 0 for the fastest
     * @param longestOfWalls  the largest wave number along walls that the grid must carry, 1/nm; 0
     *     without walls
     */
    EwaldSplitting(const std::vector<EwaldKind>& kinds, double tolerance, double spacing,
                   const BoxVectors& box, double wantedXi = 0, double longestOfWalls = 0);
    double xi = 0;          // 1/nm
    GridShape shape;        // of the grid
    double width = 0;       // width of the Gaussian that points spread, nm
    double cutoff = 0;      // where the Gaussian ends, nm
    double gap = 0;         // largest gap between the surfaces of summed pairs, nm
    double seconds = 0;     // of a product, by the model of the time
    double neighbours = 0;  // of a particle, at a uniform density
};

}  // namespace RigidHIPlugin

#endif
