#ifndef RIGIDHI_PAIR_SUMS_H_
#define RIGIDHI_PAIR_SUMS_H_

#include <cstddef>

namespace RigidHIPlugin {

/**
 * Spheres, and the forces and torques on them, for sums over pairs with the Rotne-Prager-Yamakawa
 * mobility.
 *
 * All data are in slots, one for each sphere. At `loads` begin rows of numbers for slots: row 6 c +
 * k is component k (force, then torque) of column c. Rows are `stride` numbers apart. There are one
 * or two columns.
 */
struct PairSumArrays {
    /**
     * Ranges begin at multiples of this number. Slots between the end of a range and the next
     * multiple are padding: spheres at `farAway`, without load, of radius 1.
     */
    static constexpr int alignment = 16;
    /**
     * The position of padding. No power of it that the sums make is infinite, and nothing overlaps
     * it. In floats nothing else may be so far away.
     */
    static constexpr double farAway = 1e30, farAwaySingle = 1e10, farthestSingle = 1e9;

    const double *x, *y, *z, *radius;  // of slots; z from the wall, if there is one
    bool hasWall;
    int columns;
    std::size_t stride;
    const double* loads;
    /**
     * Null, or all these data in floats. The sums are then in single precision, as
     * Accuracy::errorOfSinglePrecision promises.
     */
    const float* singleLoads;
    const float* singlePlaces;  // rows: x, y, z, the rounding errors of x, y, z, and a third of the
                                // square of the radius
};

/** Slots of one kind: their spheres either all have torques and angular velocities, or none has. */
struct SlotRange {
    int first, end;
    bool hasTorque;
};

/**
 * Add the velocities, times 8 pi eta, that two ranges of slots give each other. Each pair is taken
 * once, and both ways. If the ranges are the same, these are all pairs within the range, and the
 * own mobility of each sphere. Otherwise the ranges must have nothing in common.
 *
 * Sums are added in an order that does not depend on the width of packs. With fused multiplications
 * and additions (from AVX2 on and on NEON) their bits do not depend on this width either. In single
 * precision they do.
 *
 * @param firstSums, secondSums  the sums to which the velocities are added: row 6 c + k,
 *     `sumsStride` numbers apart, of the slots from the range's first one on, up to a multiple of
 *     PairSumArrays::alignment. If the ranges are the same, secondSums is firstSums.
 */
void addPairs(const PairSumArrays& arrays, const SlotRange& first, const SlotRange& second,
              double* firstSums, double* secondSums, std::size_t sumsStride);

}  // namespace RigidHIPlugin

#endif
