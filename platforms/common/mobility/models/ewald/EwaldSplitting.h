#ifndef RIGIDHI_EWALD_SPLITTING_H_
#define RIGIDHI_EWALD_SPLITTING_H_

#include <vector>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/** Particles of one radius. */
struct EwaldKind {
    double radius;            // nm
    int particles, torques;   // how many, and of how many the fluid takes torques
    bool stresslets = false;  // whether it takes torques and stresslets of all of them
};

/**
 * The kinds of particles, by radius.
 *
 * @param stresslets  of all particles, which then have torques
 */
std::vector<EwaldKind> kindsOf(const HydrodynamicParticles& particles, bool stresslets = false);
/** Whether the fluid takes stresslets, of some kind and so of all. */
inline bool haveStresslets(const std::vector<EwaldKind>& kinds) {
    return !kinds.empty() && kinds.front().stresslets;
}

/**
 * Where the periodic Rotne-Prager-Yamakawa mobility is split into pairs and waves, and how far each
 * of the two parts is summed.
 *
 * Method:    Of all splittings whose errors are below the tolerance, the one is taken that a model
 *            of the time calls the fastest. The constants of this model were measured once. No
 *            clock is used, so the splitting is a function of box, particles and settings.
 * Errors:    All errors are relative to own mobilities. That of waves beyond the grid's is their
 *            sum over one particle. That of pairs beyond the reach is their sum over a uniform
 *            density. The grid adds the errors of waves that it takes for others (aliasing), and of
 *            the ends of the Gaussians.
 * Reference: Lindbo, Tornberg, J. Comput. Phys. 230, 8744 (2011), for the errors of the grid.
 */
struct EwaldSplitting {
    /**
     * @param tolerance  of products: the norm of their error over the norm of the mobility, both
     *     scaled by the square roots of own mobilities
     * @param spacing  of the grid, at most, nm; 0: the fastest
     * @param box  One that leans along one axis gets the splitting of the box that leans by half an
     *     edge (GridLean), so that a box has one splitting while it is sheared.
     * @param wantedXi  for tests and benchmarks: this xi, 1/nm; 0: the fastest
     * @param longestOfWalls  the largest wave number along walls that the grid must carry, 1/nm; 0:
     *     there are no walls
     */
    EwaldSplitting(const std::vector<EwaldKind>& kinds, double tolerance, double spacing,
                   const BoxVectors& box, double wantedXi = 0, double longestOfWalls = 0);
    double xi = 0;          // 1/nm
    GridShape shape;        // of the grid
    double width = 0;       // of the Gaussian that points spread, nm
    double cutoff = 0;      // where it ends, nm
    double gap = 0;         // between surfaces of pairs, up to which they are summed, nm
    double seconds = 0;     // of a product, by the model of the time
    double neighbours = 0;  // of a particle, at a uniform density
};

}  // namespace RigidHIPlugin

#endif
