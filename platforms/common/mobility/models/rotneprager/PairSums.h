#ifndef RIGIDHI_PAIR_SUMS_H_
#define RIGIDHI_PAIR_SUMS_H_

#include <cstddef>

namespace RigidHIPlugin {

/**
 * Spheres, and the forces and torques on them, for sums over pairs with the Rotne-Prager-Yamakawa
 * mobility.
 *
 * All data are in slots, one for each sphere. `loads` points to rows of numbers for slots: row
 * 6 c + k is component k (force, then torque) of column c. Rows are `stride` numbers apart. The
 * number of columns is one or two.
 */
struct PairSumArrays {
    /**
     * Ranges begin at multiples of this number. Slots between the end of a range and the next
     * multiple are padding: spheres at `farAway`, without load, of radius 1.
     */
    static constexpr int alignment = 16;
    /**
     * The position of padding. All its powers in the sums are finite, and no sphere overlaps it. In
     * floats no other sphere may be as far away.
     */
    static constexpr double farAway = 1e30, farAwaySingle = 1e10, farthestSingle = 1e9;

    const double *x, *y, *z, *radius;  // of slots; with a wall, z counts from it
    bool hasWall;
    int columns;
    std::size_t stride;
    const double* loads;
    /**
     * Null, or all these data in floats. The sums are then in single precision, with the error
     * Accuracy::errorOfSinglePrecision.
     */
    const float* singleLoads;
    const float* singlePlaces;  // rows: x, y, z, the rounding errors of x, y, z, and a third of the
                                // square of the radius
};

/**
 * Slots of one kind: either all of their spheres have torques and angular velocities, or none has.
 */
struct SlotRange {
    int first, end;
    bool hasTorque;
};

/**
 * Add the velocities, times 8 pi eta, that two ranges of slots induce in each other. The sum visits
 * each pair once, for both directions. If the ranges are the same, it covers all pairs within the
 * range and the own mobility of each sphere. Otherwise the ranges must be disjoint.
 *
 * The order of additions does not depend on the width of packs. With fused multiplications and
 * additions (from AVX2 on and on NEON) the bits of sums in double precision do not depend on this
 * width either. In single precision they do.
 *
 * @param firstSums, secondSums  the sums of velocities: rows 6 c + k, `sumsStride` numbers apart,
 *     for the slots from the range's first slot on, up to a multiple of PairSumArrays::alignment.
 *     If the ranges are the same, secondSums is firstSums.
 */
void addPairs(const PairSumArrays& arrays, const SlotRange& first, const SlotRange& second,
              double* firstSums, double* secondSums, std::size_t sumsStride);

}  // namespace RigidHIPlugin

#endif
