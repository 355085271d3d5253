#ifndef RIGIDHI_PLAIN_PAIRS_H_
#define RIGIDHI_PLAIN_PAIRS_H_

#include <vector>

/** Particles of one radius and kind that do not overlap, and what is multiplied. */
struct PlainPairs {
    std::vector<double> x, y, z;  // z from the wall, if there is one
    double radius;
    bool hasWall, torques;
    int columns;                             // 1 or 2
    std::vector<std::vector<double>> loads;  // three rows a column, of spheres with torque six
};

/**
 * The yardstick for products with the Rotne-Prager-Yamakawa mobility: a plain loop over all pairs j < i in double precision, that fills the
 * blocks of a pair and multiplies both ways, as anybody would write it; the compiler makes packs of it, with -ffast-math, for the
 * instruction set that Highway has chosen. It has one radius, no overlaps, nothing that a sphere does to itself, no wide sums.
 *
 * @param first, step  rows of the triangle that this thread takes
 * @param velocities   as loads; added to
 */
void addPlainPairs(const PlainPairs& pairs, int first, int step, std::vector<std::vector<double>>& velocities);

#endif
