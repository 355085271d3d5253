#ifndef RIGIDHI_OVERDAMPED_SCHEMES_H_
#define RIGIDHI_OVERDAMPED_SCHEMES_H_

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "schemes/OverdampedMove.h"

namespace RigidHIPlugin {

/** A scheme without momenta, as the engine sees it. Each is written down in a file of its own, in this folder. */
struct OverdampedScheme {
    const char* name;
    /** How it makes the stochastic drift, for describeEffects(); empty: it omits it. */
    const char* drift;
    /** What it takes finite differences of, where the divergence of the mobility is not known. */
    Differenced differenced;
    /** Whether predict() needs forces at the start of the step, and correct() forces in between. */
    bool forcesAtStart, forcesInBetween;
    /** Forces in between are taken at the time t + this. */
    double (*timeOfForces)(double h);
    void (*predict)(OverdampedMove&);
    void (*correct)(OverdampedMove&);
};

/** The entry of a scheme that isOverdamped(). */
const OverdampedScheme& overdampedScheme(CustomRigidHIIntegrator::Scheme scheme);

}  // namespace RigidHIPlugin

#endif
