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
 * The effect of one step on bodies and free particles, each by itself in unbounded fluid. Names are
 * those of messages, such as "body 3".
 */
struct StepResolution {
    // Schemes without momenta: root mean squares of the random motion in a step.
    double displacement = 0, smallestRadius = 0;  // along one axis; nm
    std::string mover;
    double turn = 0;  // about the fastest axis that is not slowed, rad
    std::string turner;
    int numSlowed = 0;                // bodies whose spin is slowed
    double spin = 0, slowedSpin = 0;  // the largest real spin, and the slowed one in its place, rad
    std::string spinner;
    double longestStepOfSpins = 0;  // that slows none of them, ps
    /** The body that forces keep turning about an axis whose spin is slowed; empty: none. */
    std::string driven;
    double longestStepOfDriven = 0, slowing = 1;  // ps; the part of its mobility that the spin has

    // LangevinHI: the largest h s, where s is the rate at which a momentum relaxes.
    double relaxation = 0;
    bool relaxationIsOfRotation = false;
    std::string fastestToRelax;
};

/** The rates at which the fluid damps a body by itself, 1/ps; 0 for axes without inertia. */
struct BodyRates {
    double translation = 0;          // of the least damped direction
    double rotation[3] = {0, 0, 0};  // about the body's axes
};

/**
 * The effect of a step of a scheme without momenta on each body by itself (none at kT = 0), and
 * whether forces turn bodies whose spin is slowed.
 */
StepResolution resolveOverdamped(const FluidContents& fluid, CustomRigidHIIntegrator::Scheme scheme,
                                 double h, double kT);
/** The part of all steps that were redone, if it is surely above `bound`; else 0. */
double partRedone(long long redone, long long steps, double bound);
/** The largest such part of a group, without momenta: each group redoes its own steps. */
double partRedone(const FluidContents& fluid, double bound);
/**
 * The body or free particle with the largest value of a measure of StepWatch, and the smallest
 * radius in its group; no name: nothing was found. Where it is too large no more, the largest value
 * since positions were set.
 */
struct StepFinding {
    std::string name;
    double value = 0, smallestRadius = 0;
    bool isPast = false;  // no longer the case at present
};
/** The step over the time in which forces relax, where this ratio is too large. */
StepFinding findStiffForces(const FluidContents& fluid);
/** The mean displacement in a step relative to others, where it is too long, nm. */
StepFinding findLongDisplacements(const FluidContents& fluid);
/** The largest motion in a step, if all are tiny, in smallest radii or radians. */
StepFinding findCrawling(const FluidContents& fluid);
/** Positions were set from outside, and do not follow from the step before. */
void interruptWatches(const FluidContents& fluid);
/** Whether the steps so far show forces that keep turning bodies whose spin is slowed. */
bool drivesSlowedSpins(const FluidContents& fluid);
/**
 * The root mean square of nu - 1 of drift-correctors over steps so far, for the group where it is
 * largest; 0 before enough steps.
 */
double driftFactorSpread(const FluidContents& fluid);
/** Lower bounds of the rates at which the fluid damps the momenta of a body by itself. */
BodyRates findRates(const FluidContents& fluid, int body, const BodyInertia& inertia);
/** How far momenta relax in a step of LangevinHI. */
StepResolution resolveRelaxation(const FluidContents& fluid, double h, const BodySet& bodies,
                                 const FreeParticles& freeParticles);

}  // namespace RigidHIPlugin

#endif
