#ifndef RIGIDHI_MID_STEP_H_
#define RIGIDHI_MID_STEP_H_

#include <openmm/Vec3.h>

#include "host/StepSettings.h"
#include "rigidbody/BodySet.h"
#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {

/**
 * Mid-step momenta: with them the first drift of the next step moves bodies and particles. Their
 * kinetic energy is averaged over the noise that the step draws before this drift, so that no
 * random numbers are needed. At long steps their temperature has a far smaller error than that of
 * the momenta between two steps (docs/theory/thermostats.md).
 */
struct MidStepEnergies {
    double translational = 0, rotational = 0;  // of bodies, kJ/mol
    double free = 0;                           // of free particles, kJ/mol
    OpenMM::Vec3 momentum;                     // of all bodies, amu nm/ps
};

/**
 * The mid-step energies of bodies, from the forces gathered last and the thermostats of the bodies.
 * Those of free particles are FreeParticles::midStepKineticEnergy().
 */
MidStepEnergies midStepEnergies(const BodySet& bodies, const StepSettings& settings);
/**
 * The two parts of midStepEnergies(): that of the mean momenta, and that of the noise about them.
 * The second part does not change from step to step.
 */
MidStepEnergies midStepEnergiesOfMeans(const BodySet& bodies, const StepSettings& settings);
MidStepEnergies midStepEnergiesOfNoise(const BodySet& bodies, const StepSettings& settings);

/** A momentum of one component that no force acts upon, in its stationary state. */
struct FreeMomentum {
    double relaxation = 0;  // rate of relaxation times the step; 0: nothing damps the momentum
    double ratio = 1;       // mid-step temperature over that of the bath
};
/** @param inertia  mass or moment */
FreeMomentum freeMomentum(const StepSettings& settings, double inertia, double decay, double noise);

}  // namespace RigidHIPlugin

#endif
