#ifndef RIGIDHI_MID_STEP_H_
#define RIGIDHI_MID_STEP_H_

#include <openmm/Vec3.h>

#include "host/StepSettings.h"
#include "rigidbody/BodySet.h"
#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {

/**
 * Energies of the mid-step momenta. These are the momenta with which the first drift of the next
 * step moves bodies and particles. The kinetic energy is a mean over the noise that the step draws
 * before this drift, so that it needs no random numbers. At long steps the temperature of mid-step
 * momenta has a far smaller error than that of the momenta between two steps
 * (docs/theory/thermostats.md).
 */
struct MidStepEnergies {
    double translational = 0, rotational = 0;  // of bodies, kJ/mol
    double free = 0;                           // of free particles, kJ/mol
    OpenMM::Vec3 momentum;                     // of all bodies, amu nm/ps
};

/**
 * The mid-step energies of bodies, from the forces gathered last and the thermostats of the bodies.
 * FreeParticles::midStepKineticEnergy() gives those of free particles.
 */
MidStepEnergies midStepEnergies(const BodySet& bodies, const StepSettings& settings);
/**
 * The two parts of midStepEnergies(): the energy of the mean momenta, and that of the noise about
 * the mean. The second part does not change from step to step.
 */
MidStepEnergies midStepEnergiesOfMeans(const BodySet& bodies, const StepSettings& settings);
MidStepEnergies midStepEnergiesOfNoise(const BodySet& bodies, const StepSettings& settings);

/** The stationary state of one component of a momentum on which no force acts. */
struct FreeMomentum {
    double relaxation = 0;  // rate of relaxation times the step; 0: nothing damps the momentum
    double ratio = 1;       // mid-step temperature over that of the bath
};
/** @param inertia  mass or moment */
FreeMomentum freeMomentum(const StepSettings& settings, double inertia, double decay, double noise);

}  // namespace RigidHIPlugin

#endif
