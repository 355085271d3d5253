#ifndef RIGIDHI_BODY_MOBILITIES_H_
#define RIGIDHI_BODY_MOBILITIES_H_

#include <memory>

#include "rigid/BodyMobility.h"

namespace RigidHIPlugin {

/**
 * The strategies for one group of bodies: which class serves which way is known here only. Each is
 * made when it is first asked for, and shared by all who ask for it: they set poses and tolerance
 * before use.
 */
class BodyMobilities {
public:
    /** @param tolerance  of the matrix-free way, as the user has set it */
    BodyMobilities(const CoupledBodies& bodies, double tolerance)
        : bodies(bodies), tolerance(tolerance) {}
    /** @param way  Constant only where the bodies are so (CoupledBodies), Krylov only where the
     * model has products */
    BodyMobility& get(BodyMobility::Way way);
    /** Of all of them. */
    MobilityCosts getCosts() const;

private:
    const CoupledBodies& bodies;
    const double tolerance;
    std::unique_ptr<BodyMobility> made[3];  // by way
};

}  // namespace RigidHIPlugin

#endif
