#ifndef RIGIDHI_COINCIDENCE_CHECK_H_
#define RIGIDHI_COINCIDENCE_CHECK_H_

#include <utility>
#include <vector>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * Looks for two particles of one radius at one place. Such particles cannot move apart, so their
 * mobility matrix is singular.
 *
 * Bound: let d be the distance of two particles and D the difference of their radii, both relative
 * to the smaller radius. In units in which every diagonal entry is 1, the smallest eigenvalue of
 * the pair's Rotne-Prager-Yamakawa matrix is at least 3/16 of the larger of d and D (with torques
 * too). The largest eigenvalue of n rows is at most n, and the rounding of a Cholesky factorisation
 * is n times the largest eigenvalue times 2e-16. So with d or D above 1e-6 the matrix is positive
 * definite in double precision up to 3e4 rows. Where both d and D are below 1e-6, rounding decides
 * whether the factorisation succeeds. Two spheres of different radii may be at one place, because
 * they feel the fluid differently.
 *
 * Cost: a sort of the particles. Nothing is allocated after the first call.
 */
class CoincidenceCheck {
public:
    static constexpr double bound = 1e-6;  // of the smaller radius
    struct Pair {
        int first = -1, second = -1;  // first < second; -1: no pair
        double distance = 0;          // nm
    };
    /**
     * The first pair of coinciding particles, in the order of particles.
     *
     * @param places  positions at which the formulas take the particles
     *     (MobilityModel::placeInFormulas()), nm
     * @param inOneBody  the bound for two particles of one body, relative to the bound for other
     *     pairs. The sites of a body are checked once with 1. After their rotation to the lab
     *     frame, half of the bound leaves room for rounding.
     */
    Pair find(const HydrodynamicParticles& particles, const std::vector<OpenMM::Vec3>& places,
              double inOneBody);
    /**
     * @throws OpenMMException if two particles coincide. The message names particles, distance,
     *     bound and remedy.
     */
    void check(const HydrodynamicParticles& particles, const std::vector<OpenMM::Vec3>& places,
               double inOneBody);

private:
    std::vector<std::pair<double, int>> order;  // particles, sorted along a line
};

}  // namespace RigidHIPlugin

#endif
