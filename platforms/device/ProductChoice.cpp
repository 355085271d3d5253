#include "ProductChoice.h"

#include <openmm/OpenMMException.h>

#include <cstdlib>

namespace RigidHIPlugin {

namespace {

/**
 * The range of particle numbers for which the device makes products, for errors from `error` on. An
 * H200 is faster than 16 cores with AVX-512 (docs/gpu.md) from 1000 particles on. At 1e-3 it takes
 * 0.35 of the time of multipoles at 30,000 particles unbounded, and 0.28 above a wall. The other
 * limits are extrapolations: the time of sums over all pairs grows with the square of the number,
 * the time of multipoles nearly linearly, with a factor that grows with the digits.
 */
struct Row {
    double error;
    int fewest[2], most[2];  // unbounded, above a wall
};
const Row rows[] = {
    {1e-2, {1000, 1000}, {60000, 60000}},   {1e-3, {1000, 1000}, {85000, 100000}},
    {1e-4, {1000, 1000}, {120000, 140000}}, {1e-5, {1000, 1000}, {160000, 200000}},
    {1e-6, {1000, 1000}, {200000, 250000}},
};

}  // namespace

ProductWish productWish() {
    const char* const text = std::getenv("RIGIDHI_PRODUCTS");
    const std::string wish = text ? text : "";
    if (wish.empty() || wish == "auto") return ProductWish::Auto;
    if (wish == "device") return ProductWish::Device;
    if (wish == "host") return ProductWish::Host;
    throw OpenMM::OpenMMException("The environment variable RIGIDHI_PRODUCTS is '" + wish +
                                  "'; it must be device, host or auto, or not be set");
}

bool deviceIsFaster(int numParticles, bool hasWall, bool hasMultipoles, double error) {
    // A tolerance of 1e-6 may come from a product of other numbers, with its rounding.
    const double rounding = 1e-12;
    for (const Row& row : rows)
        if (row.error <= error * (1 + rounding))
            return numParticles >= row.fewest[hasWall] &&
                   (!hasMultipoles || numParticles <= row.most[hasWall]);
    return false;
}

int fewestForDevice(bool hasWall) { return rows[0].fewest[hasWall]; }

}  // namespace RigidHIPlugin
