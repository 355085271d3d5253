#ifndef RIGIDHI_FREE_PARTICLES_H_
#define RIGIDHI_FREE_PARTICLES_H_

#include <openmm/System.h>
#include <openmm/Vec3.h>

#include <memory>
#include <vector>

#include "host/PlatformLoops.h"
#include "rigidbody/Thermostat.h"

namespace OpenMM {
class ReferenceConstraints;
}

namespace RigidHIPlugin {

/**
 * The particles in no body that have mass, or that the fluid sees. They take the same schemes as
 * bodies, as point particles. Held ones stay where they are. Constraints among the particles hold
 * positions after every drift and velocities after every move. The state of the particles is in the
 * Context's arrays.
 */
class FreeParticles {
public:
    FreeParticles() = default;
    /**
     * @param particles  indices of the particles in no body that have mass, or that the fluid sees
     * @param ofContext  OpenMM's constraints of the whole System, which must outlive this object;
     *     null: none
     */
    FreeParticles(const OpenMM::System& system, const std::vector<int>& particles,
                  OpenMM::ReferenceConstraints* ofContext);
    ~FreeParticles();
    int getNumParticles() const { return particles.size(); }
    int getNumConstraints() const { return numConstraints; }
    const std::vector<int>& getParticles() const { return particles; }
    /**
     * Set which particles of the System are held. The method ignores particles that are not in this
     * object. The caller must set thermostats anew.
     * @return whether this changes anything
     */
    bool setHeld(const std::vector<int>& particlesOfSystem);
    bool isHeld(int i) const { return held[i]; }
    int getNumHeld() const { return numHeld; }
    /** Set the velocities of held particles to 0. @return their indices in the System */
    std::vector<int> stopHeld(std::vector<OpenMM::Vec3>& velocities) const;

    /**
     * The part of a step before the force evaluation, and the part after it. @return whether
     * results are finite, and how many random numbers were drawn
     */
    LoopResult beforeForces(const StepSettings& settings, PlatformLoops& loops,
                            std::vector<OpenMM::Vec3>& positions,
                            std::vector<OpenMM::Vec3>& velocities, double constraintTolerance);
    /**
     * LangevinHI: beforeForces() in two parts, between which the fluid changes velocities.
     */
    LoopResult beforeFriction(const StepSettings& settings, PlatformLoops& loops,
                              std::vector<OpenMM::Vec3>& positions,
                              std::vector<OpenMM::Vec3>& velocities, double constraintTolerance);
    LoopResult afterFriction(const StepSettings& settings, PlatformLoops& loops,
                             std::vector<OpenMM::Vec3>& positions,
                             std::vector<OpenMM::Vec3>& velocities, double constraintTolerance);
    LoopResult afterForces(const StepSettings& settings, PlatformLoops& loops,
                           std::vector<OpenMM::Vec3>& positions,
                           std::vector<OpenMM::Vec3>& velocities, double constraintTolerance);
    /**
     * Copy the forces, since other code may overwrite them in the Context. @return whether they are
     * finite
     */
    bool gatherForces(const std::vector<OpenMM::Vec3>& contextForces);
    void setThermostats(const std::vector<Thermostat>& perParticle);
    double kineticEnergy(const std::vector<OpenMM::Vec3>& velocities) const;
    /**
     * The kinetic energy of the mid-step momenta (MidStep.h), from the forces gathered last.
     * @param velocities  at the end of a step
     */
    double midStepKineticEnergy(const StepSettings& settings, std::vector<OpenMM::Vec3>& positions,
                                std::vector<OpenMM::Vec3> velocities, double constraintTolerance);
    double mass(int i) const { return masses[i]; }
    OpenMM::Vec3 getForce(int i) const { return forces[i]; }
    void setForce(int i, const OpenMM::Vec3& force) { forces[i] = force; }
    const Thermostat& getThermostat(int i) const { return thermostats[i]; }

    struct Snapshot {
        std::vector<OpenMM::Vec3> positions, velocities, forces;
    };
    void save(Snapshot& snapshot, const std::vector<OpenMM::Vec3>& positions,
              const std::vector<OpenMM::Vec3>& velocities) const;
    void restore(const Snapshot& snapshot, std::vector<OpenMM::Vec3>& positions,
                 std::vector<OpenMM::Vec3>& velocities);
    /** Restore position and force of one particle. */
    void restore(const Snapshot& snapshot, int i, std::vector<OpenMM::Vec3>& positions);

private:
    class Flow;
    std::vector<int> particles;
    std::vector<double> masses;
    std::vector<char> held;
    int numHeld = 0;
    std::vector<Thermostat> thermostats;
    std::vector<int> noisyParticles,
        noiseOf;  // particles with noise; for each particle its index among them, or -1
    std::vector<OpenMM::Vec3> forces;
    std::vector<double> noise;
    int numConstraints = 0;
    std::unique_ptr<OpenMM::System> constraintSystem;
    std::unique_ptr<OpenMM::ReferenceConstraints> ownConstraints;
    OpenMM::ReferenceConstraints* constraints = nullptr;  // their own, or the Context's
    std::vector<double>
        inverseMasses;  // of all particles of the System; 0 where constraints must not act
    std::vector<OpenMM::Vec3> before, after;
};

}  // namespace RigidHIPlugin

#endif
