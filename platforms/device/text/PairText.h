#ifndef RIGIDHI_PAIR_TEXT_H_
#define RIGIDHI_PAIR_TEXT_H_

#include "text/KernelText.h"

namespace RigidHIPlugin {

/** A kind of particles and fluid, with its own kernels of products. */
struct PairKind {
    bool hasTorque;  // whether particles have torques and angular velocities
    bool hasWall;
};

// The host's formulas for a pair of spheres i and j, as programs: the templates of
// mobility/models/rotneprager and mobility/models/wall, run over lines. Inputs and outputs have the
// names of the variables of kernels/pairs.cc.

/** Computes `compared` and `bound`. Spheres are apart if the first is greater than the second. */
Program pairComparison();
/** The factors m_ttI ... of a pair that is apart, or that overlaps. */
Program pairFactors(PairKind kind, bool apart);
/** Adds to velocities of i those that forces on j cause in unbounded fluid. */
Program pairVelocities(PairKind kind);
/** Adds the contribution of the wall. */
Program wallVelocities(PairKind kind);

/** The program of products. */
KernelProgram pairProgram(PairKind kind);

/**
 * The number of targets of a group of threads, and the numbers of sources in a tile and in a part
 * of it. Sums over a tile are in floats: first over the sources of each part, then over parts.
 */
constexpr int pairGroup = 128, pairTile = 64, pairPart = 8;

}  // namespace RigidHIPlugin

#endif
