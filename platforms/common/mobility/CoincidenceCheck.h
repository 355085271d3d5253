#ifndef RIGIDHI_COINCIDENCE_CHECK_H_
#define RIGIDHI_COINCIDENCE_CHECK_H_

#include <utility>
#include <vector>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * Looks for two particles of one radius at one place, whose mobility matrix is singular: they
 * cannot move apart.
 *
 * Bound: with distance d and difference D of radii, both relative to the smaller radius, the
 * smallest eigenvalue of the pair's Rotne-Prager-Yamakawa matrix, in units in which every diagonal
 * entry is 1, is 3/16 of the larger of d and D, or more (with torques too). The largest eigenvalue
 * of n rows is at most n, and Cholesky's rounding n times that times 2e-16. So with d or D above
 * 1e-6 the matrix is positive definite in double precision up to 3e4 rows; where both are below,
 * whether a factor is found becomes a matter of rounding. A sphere inside another one of a
 * different radius is no problem: they feel the fluid differently. Cost:  a sort of the particles;
 * nothing is allocated after the first call.
 */
class CoincidenceCheck {
public:
    static constexpr double bound = 1e-6;  // of the smaller radius
    struct Pair {
        int first = -1, second = -1;  // first < second; -1: no pair
        double distance = 0;          // nm
    };
    /**
     * The first such pair, in the order of particles.
     *
     * @param places       where formulas take the particles to be, nm
     * @param inOneBody    the bound for particles of one body, relative to that for others. Their
     * sites are checked once with 1; after rotation to the lab half of it leaves room for rounding
     */
    Pair find(const HydrodynamicParticles& particles, const std::vector<OpenMM::Vec3>& places,
              double inOneBody);
    /** @throws OpenMMException if there is one, naming particles, distance, bound and remedy */
    void check(const HydrodynamicParticles& particles, const std::vector<OpenMM::Vec3>& places,
               double inOneBody);

private:
    std::vector<std::pair<double, int> > order;  // of particles along a line
};

}  // namespace RigidHIPlugin

#endif
