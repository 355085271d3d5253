#ifndef RIGIDHI_NEAR_PAIR_H_
#define RIGIDHI_NEAR_PAIR_H_

#include <Eigen/Core>

#include "mobility/models/periodic/PairFunctions.h"

namespace RigidHIPlugin {

/** Hasimoto's H(k) = (1 + k^2/4 xi^2) exp(-k^2/4 xi^2), between 0 and 1. */
inline double hasimoto(double k, double xi) {
    const double x = 0.25 * k * k / (xi * xi);
    return (1 + x) * std::exp(-x);
}

/**
 * The pair mobility of two spheres of radii a_i and a_j in unbounded fluid from the part 1 - H(k)
 * of the fluid's modes, with force and torque spread over the surfaces of the spheres. It is the
 * Rotne-Prager-Yamakawa mobility without the part of waves.
 *
 * Equation:  The integrals over k of PairFunctions.h with the weight 1 - H. Both parts are Gram
 *            matrices, so both are positive semidefinite in every box.
 * Method:    The closed form, also for overlap, minus the integral with H. The integrand is even in
 *            k, analytic and cut off by a Gaussian, so the trapezoidal rule is exact to rounding
 *            with some 30 nodes. A closed form of the difference would suffer cancellation for
 *            small radii and distances.
 * Reference: Fiore, Balboa Usabiaga, Donev, Swan, J. Chem. Phys. 146, 124116 (2017); LatticeSum.h.
 */
class NearPair {
public:
    /**
     * @param xi  1/nm; 0 < xi
     * @param torques, stresslets  whether to compute their functions, too
     */
    NearPair(double a_i, double a_j, double xi, bool torques, bool stresslets = false);
    /**
     * The functions in units of 1/(8 pi eta).
     *
     * @param distance  nm, at most getReach()
     */
    PairFunctions at(double distance) const;
    /** The part with H, an entire function of the distance squared. */
    PairFunctions screened(double distance) const;
    /** The closed form minus `screened`. */
    PairFunctions withoutScreened(double distance, const PairFunctions& screened) const;
    /** The distance beyond which the functions are below 1e-15. */
    double getReach() const { return reach; }
    double getContact() const { return a_i + a_j; }

private:
    const double a_i, a_j;
    const bool torques, stresslets;
    double reach;
    Eigen::ArrayXd nodes, ss, st, ts, tt;
};

}  // namespace RigidHIPlugin

#endif
