#ifndef RIGIDHI_PAIR_SUMS_H_
#define RIGIDHI_PAIR_SUMS_H_

#include <cstddef>

namespace RigidHIPlugin {

/**
 * Spheres, and the forces and torques on them, for sums over pairs with the Rotne-Prager-Yamakawa
 * mobility.
 *
 * Everything lies in slots, one for a sphere. What begins at `loads` are rows of numbers for slots,
 * row 6 c + k for component k (force, then torque) of column c; rows are `stride` numbers apart.
 * There are one or two columns.
 */
struct PairSumArrays {
    /** Ranges begin at multiples of this, and slots between the end of one and the next multiple
     * are padding: `farAway`, without load, of radius 1. */
    static constexpr int alignment = 16;
    /** Where padding is: no power of it is infinite that sums make, and nothing overlaps it. In
     * floats nothing else may be so far. */
    static constexpr double farAway = 1e30, farAwaySingle = 1e10, farthestSingle = 1e9;

    const double *x, *y, *z, *radius;  // of slots; z from the wall, if there is one
    bool hasWall;
    int columns;
    std::size_t stride;
    const double* loads;
    /** Null, or all of this in floats, and then sums are in single precision, as
     * CpuRotnePragerYamakawaAt::applyRoughly() promises. */
    const float* singleLoads;
    const float* singlePlaces;  // rows: x, y, z, what rounding left of x, y, z, and a third of the
                                // square of the radius
};

/** Slots of one kind, whether or not their spheres have torques and angular velocities. */
struct SlotRange {
    int first, end;
    bool hasTorque;
};

/**
 * Velocities, times 8 pi eta, that two ranges of slots give each other: each pair is taken once,
 * and both ways. If the ranges are the same, that is all pairs within, and what each sphere does to
 * itself; otherwise they must have nothing in common.
 *
 * Sums are added in an order that does not depend on the width of packs; with fused multiplications
 * and additions, which is from AVX2 on and on NEON, their bits do not either. In single precision
 * they do.
 *
 * @param firstSums, secondSums  to which they are added: row 6 c + k, `sumsStride` numbers apart,
 * of the slots from the range's first one on, up to a multiple of PairSumArrays::alignment. The
 * same ranges: secondSums is firstSums.
 */
void addPairs(const PairSumArrays& arrays, const SlotRange& first, const SlotRange& second,
              double* firstSums, double* secondSums, std::size_t sumsStride);

}  // namespace RigidHIPlugin

#endif
