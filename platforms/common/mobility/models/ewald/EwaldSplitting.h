#ifndef RIGIDHI_EWALD_SPLITTING_H_
#define RIGIDHI_EWALD_SPLITTING_H_

#include <vector>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/** Particles of one radius. */
struct EwaldKind {
    double radius;           // nm
    int particles, torques;  // how many, and of how many the fluid takes torques
};

/** The kinds of particles, by radius. */
std::vector<EwaldKind> kindsOf(const HydrodynamicParticles& particles);

/**
 * Where periodic Rotne-Prager-Yamakawa is split into pairs and waves, and how far each of both is
 * summed.
 *
 * Method:    of all splittings whose errors are below the tolerance the one that a model of the
 * time calls the fastest, from constants measured once: never by a clock, so that it is a function
 * of box, particles and settings. Errors, each over own mobilities: waves beyond the grid's, by
 * their sum over one particle; pairs beyond the reach, by their sum over a uniform density; waves
 * that the grid takes for others, and the ends of Gaussians. Reference: Lindbo, Tornberg, J.
 * Comput. Phys. 230, 8744 (2011), for the latter two.
 */
struct EwaldSplitting {
    /**
     * @param tolerance  of products: norm of their error over the norm of the mobility, both over
     * the roots of own mobilities
     * @param spacing    the grid's, at most, nm; 0: the fastest
     * @param box        with edges along the axes
     * @param wantedXi   for tests and benchmarks: this xi, 1/nm; 0: the fastest
     */
    EwaldSplitting(const std::vector<EwaldKind>& kinds, double tolerance, double spacing,
                   const BoxVectors& box, double wantedXi = 0);
    double xi = 0;          // 1/nm
    GridShape shape;        // of the grid
    double width = 0;       // of the Gaussian that points spread, nm
    double cutoff = 0;      // where it ends, nm
    double gap = 0;         // between surfaces of pairs, up to which they are summed, nm
    double seconds = 0;     // of a product, as the model of the time says it
    double neighbours = 0;  // of a particle, at a uniform density
};

}  // namespace RigidHIPlugin

#endif
