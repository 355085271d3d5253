#ifndef RIGIDHI_FORCE_COUPLING_AT_WALL_H_
#define RIGIDHI_FORCE_COUPLING_AT_WALL_H_

#include <vector>

#include "linearalgebra/ChebyshevSeries.h"
#include "mobility/models/wall/SphereWall.h"

namespace RigidHIPlugin {

/**
 * The mobility of one sphere of ForceCoupling above one no-slip wall, without images along it: the
 * limit of ConfinedForceCoupling for a wide box and high fluid.
 *
 * Equation:  The wall takes U S^-1 U^+ from the mobility in unbounded fluid, integrated over the
 *            wave vectors k along the wall. S is the response of unbounded fluid on planes at rest
 *            to forces on them (PlaneConditions), and U that at the Gaussian envelopes of the
 *            sphere. Averages of exp(-k |z|) over an envelope are error functions. Envelopes reach
 *            a little beyond the wall, where ConfinedForceCoupling has another plane at rest.
 * Accuracy:  1e-11 of the mobilities of unbounded fluid. In a channel or film, further planes
 * behind the wall change the model's mobilities by 1e-5. Method:    One Chebyshev series in the
 * radius over the height. Cost:      Construction 20 ms, evaluation 0.1 us.
 */
class ForceCouplingAtWall {
public:
    /** @param behind  how far behind the wall the other plane is, in radii of the sphere */
    explicit ForceCouplingAtWall(double behind);
    /** @param u  radius over height of the centre, in (0, 1] */
    SphereWallMobility at(double u) const;
    /** The integral itself. */
    static SphereWallMobility integral(double u, double behind);

private:
    ChebyshevSeries<5, 48> series;
};

}  // namespace RigidHIPlugin

#endif
