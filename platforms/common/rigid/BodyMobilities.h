#ifndef RIGIDHI_BODY_MOBILITIES_H_
#define RIGIDHI_BODY_MOBILITIES_H_

#include <memory>

#include "rigid/BodyMobility.h"

namespace RigidHIPlugin {

/**
 * The strategies for one group of bodies. Only this class knows which class implements which
 * strategy. get() makes a strategy when it is first asked for. All callers share it, so they set
 * poses and tolerance before use.
 */
class BodyMobilities {
public:
    /** @param tolerance  of the matrix-free strategy, as the user has set it */
    BodyMobilities(const CoupledBodies& bodies, double tolerance)
        : bodies(bodies), tolerance(tolerance) {}
    /**
     * @param way  Constant is only for constant bodies (CoupledBodies), Krylov only for models with
     *     products
     */
    BodyMobility& get(BodyMobility::Way way);
    /** The costs of all strategies together. */
    MobilityCosts getCosts() const;

private:
    const CoupledBodies& bodies;
    const double tolerance;
    std::unique_ptr<BodyMobility> made[3];  // by way
};

}  // namespace RigidHIPlugin

#endif
