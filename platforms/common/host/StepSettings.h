#ifndef RIGIDHI_STEP_SETTINGS_H_
#define RIGIDHI_STEP_SETTINGS_H_

#include "openmmrigidhi/SchemeTraits.h"
#include "random/CounterNoise.h"

namespace RigidHIPlugin {

/** The settings of one step for the loops over bodies. */
struct StepSettings {
    CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::LangevinC;
    double h = 0, kT = 0;
    /**
     * LangevinHI: some bodies feel each other, or some components are fixed, so that a step has a
     * part before and a part after the fluid's part.
     */
    bool needsMiddle = false;
    NoiseStream noise;
    bool forcesAreGathered = false;  // before AfterForces, with the forces of CustomBodyForces
    double difference = 0;           // setFiniteDifferenceStep()
    CustomRigidHIIntegrator::DriftCorrectorScaling driftCorrectorScaling =
        CustomRigidHIIntegrator::SlipOnly;
    const SchemeTraits& traits() const { return traitsOf(scheme); }
    bool hasMomenta() const { return traits().hasMomenta; }
};

/**
 * The Context's arrays, three doubles a particle, and copies of what this plugin last wrote to
 * them.
 */
struct ParticleArrays {
    double *positions, *velocities;
    const double* forces;
    double *lastPositions, *lastVelocities;
};

/** The result of a loop over bodies, or over groups of bodies in a fluid. */
struct LoopResult {
    bool finite = true;
    long long randomNumbers = 0;
    long long squareRoots = 0, iterations = 0;  // of the fluid's mobilities
    void add(const LoopResult& other) {
        finite = finite && other.finite;
        randomNumbers += other.randomNumbers;
        squareRoots += other.squareRoots;
        iterations += other.iterations;
    }
};

/** The loops over bodies of one step; see BodyLoops-inl.h. */
enum class BodyLoop {
    BeforeForces,       // the scheme up to the force evaluation; new positions to the particles
    BeforeFriction,     // LangevinHI: the scheme up to the fluid's part; new poses
    AfterFriction,      // then up to the force evaluation; new positions to the particles
    AfterForces,        // forces from the particles; the rest of the scheme; new velocities to the
                        // particles
    GatherForces,       // forces from the particles only
    ScatterPositions,   // poses to the particles
    ScatterVelocities,  // twists to the particles
    TakeInVelocities,   // momenta from the particles, in blocks where their masses make the bodies
    TakeInAndScatterVelocities  // the same, and the twists back to the particles
};

}  // namespace RigidHIPlugin

#endif
