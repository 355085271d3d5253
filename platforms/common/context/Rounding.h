#ifndef RIGIDHI_ROUNDING_H_
#define RIGIDHI_ROUNDING_H_

#include <openmm/Vec3.h>

#include <algorithm>
#include <cmath>

namespace RigidHIPlugin {

/**
 * Device platforms have fixed-point forces below 2^31 kJ/(mol nm). NaN and larger forces come back
 * as about this number.
 */
const double largestFixedPointForce = 2e9;

/**
 * How a platform rounds positions and velocities. An array that the platform returns counts as
 * unchanged if it differs from the given one by no more than this.
 */
struct Rounding {
    /** A few units in the last place, relative; 0 where the platform keeps every bit. */
    double positions = 0, velocities = 0;
    bool isExact() const { return positions == 0 && velocities == 0; }
    /** The rounding of numbers that two platforms have rounded, one after the other. */
    Rounding operator+(const Rounding& other) const {
        Rounding sum;
        sum.positions = positions + other.positions;
        sum.velocities = velocities + other.velocities;
        return sum;
    }
};

/**
 * Whether `read` may be the rounded form in which a platform returns `given`.
 *
 * @param relative  Rounding::positions or velocities
 * @param beside    the largest length that was added and subtracted meanwhile: of the periodic box,
 *     for positions
 */
inline bool isRounded(const OpenMM::Vec3& read, const OpenMM::Vec3& given, double relative,
                      double beside = 0) {
    double largest = beside;
    for (int k = 0; k < 3; k++) largest = std::max(largest, std::abs(given[k]));
    bool within = std::isfinite(largest);  // infinity is no rounding of anything
    for (int k = 0; k < 3; k++)
        within = within && std::abs(read[k] - given[k]) <= relative * largest;
    return within;
}

}  // namespace RigidHIPlugin

#endif
