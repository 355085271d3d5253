#ifndef RIGIDHI_STEP_RESOLUTION_H_
#define RIGIDHI_STEP_RESOLUTION_H_

#include <string>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"

namespace RigidHIPlugin {

class BodySet;
class FreeParticles;
struct BodyInertia;
struct FluidContents;

/**
 * What one step does to bodies and free particles, each by itself in unbounded fluid. The names are
 * those of messages, such as "body 3".
 */
struct StepResolution {
    // Schemes without momenta. Root mean squares of the random motion in a step.
    double displacement = 0, smallestRadius = 0;  // along one axis; nm
    std::string mover;
    double turn = 0;  // about the fastest axis of those that are not slowed, rad
    std::string turner;
    int numSlowed = 0;                // bodies whose spin is slowed
    double spin = 0, slowedSpin = 0;  // the largest real one and what the step has of it, rad
    std::string spinner;
    double longestStepOfSpins = 0;  // that slows none of them, ps
    /** The body that forces keep turning about an axis whose spin is slowed; empty: none. */
    std::string driven;
    double longestStepOfDriven = 0, slowing = 1;  // ps; the part of its mobility that the spin has

    // LangevinHI: the largest h s, s the rate at which a momentum relaxes.
    double relaxation = 0;
    bool relaxationIsOfRotation = false;
    std::string fastestToRelax;
};

/** The rates at which the fluid damps a body by itself, 1/ps; 0 for axes without inertia. */
struct BodyRates {
    double translation = 0;          // of the direction that is damped least
    double rotation[3] = {0, 0, 0};  // about the body's axes
};

/**
 * What a step of a scheme without momenta does to each body by itself (at kT = 0 nothing), and
 * whether forces turn bodies whose spin is slowed.
 */
StepResolution resolveOverdamped(const FluidContents& fluid, CustomRigidHIIntegrator::Scheme scheme,
                                 double h, double kT);
/** The part of steps that were redone, where it is surely more than `bound`; else 0. */
double partRedone(long long redone, long long steps, double bound);
/** The largest such part of a group, without momenta: each group redoes its own steps. */
double partRedone(const FluidContents& fluid, double bound);
/** Whether the steps so far show such forces. */
bool drivesSlowedSpins(const FluidContents& fluid);
/**
 * The root mean square of nu - 1 of drift-correctors over steps so far, for the group where it is
 * largest; 0 before there are enough steps to tell.
 */
double driftFactorSpread(const FluidContents& fluid);
/** The rates at which the fluid damps the momenta of a body by itself, at least. */
BodyRates findRates(const FluidContents& fluid, int body, const BodyInertia& inertia);
/** How far momenta relax in a step of LangevinHI. */
StepResolution resolveRelaxation(const FluidContents& fluid, double h, const BodySet& bodies,
                                 const FreeParticles& freeParticles);

}  // namespace RigidHIPlugin

#endif
