#ifndef RIGIDHI_PLAIN_PAIRS_H_
#define RIGIDHI_PLAIN_PAIRS_H_

#include <vector>

/**
 * Particles of one radius and kind that do not overlap, and the vectors to multiply. Vectors have
 * room for an additional pack.
 */
struct PlainPairs {
    int count;
    std::vector<double> x, y, z;  // with a wall, z is the height above it
    double radius;
    bool hasWall, torques;
    int columns;                             // 1 or 2
    std::vector<std::vector<double>> loads;  // three rows for each column, or six for spheres with
                                             // torque
};

/**
 * The yardstick for products with the Rotne-Prager-Yamakawa mobility: a plain loop over all pairs j
 * < i in double precision, with packs of j for each i, and a square root and a division for each
 * distance. Results for i are summed in registers; results for j are loaded, added to and stored.
 * In unbounded fluid 1 and r r^T multiply a force, above a wall the block of the pair and its
 * transpose. All particles have one radius, none overlap, and the own mobility of a sphere is left
 * out.
 *
 * @param first, step  rows of the triangle that this thread takes
 * @param velocities  the results, which are added; shape as `loads`
 */
void addPlainPairs(const PlainPairs& pairs, int first, int step,
                   std::vector<std::vector<double>>& velocities);

#endif
