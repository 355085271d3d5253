#ifndef RIGIDHI_SCENE_H_
#define RIGIDHI_SCENE_H_

#include <openmm/System.h>
#include <openmm/internal/ContextImpl.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "context/AdoptedSettings.h"
#include "context/BodyDefinitions.h"
#include "context/ContextArrays.h"
#include "context/ContextFluid.h"
#include "context/NoiseHistory.h"
#include "context/StepCounters.h"
#include "context/SystemCheck.h"
#include "context/TemperatureWatch.h"
#include "context/WarningPrinter.h"
#include "forces/BodyForces.h"
#include "forces/BodyMotions.h"
#include "host/FreeParticles.h"
#include "host/NativeSteps.h"
#include "host/PlatformLoops.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/** The key of random numbers that a seed stands for. A seed of 0 stands for a fresh key. */
uint32_t seedOrFresh(int seed);

/**
 * The moving parts of one Context: bodies, free particles, the fluid between them, and the settings
 * of steps.
 */
class Scene {
public:
    /**
     * Check the System against the integrator, and make the parts that need no positions. @throws
     * OpenMMException if a System is refused
     */
    Scene(OpenMM::ContextImpl& context, const CustomRigidHIIntegrator& integrator,
          std::unique_ptr<ContextArrays> arrays, std::unique_ptr<PlatformLoops> loops);
    Scene(const Scene&) = delete;

    /**
     * Make all parts that depend on the geometries of the bodies, or throw and leave the scene as
     * it was. States stay at the origin until positions are taken in.
     */
    void build(const std::vector<BodyGeometry>& geometries);
    /**
     * Build with the geometries that positions complete. The geometries count as known only after
     * all parts that depend on them are made.
     */
    void buildFromPositions();
    /** Forget implicit geometries, so that they are found anew. */
    void resetGeometry();
    /** Whether build() was called, and resetGeometry() was not called since. */
    bool isBuilt() const { return built; }
    /** Recompute values that depend on settings, and print warnings, if any setting has changed. */
    void updateSettings() {
        if (!settings.areAdopted(integrator)) warnings.print(settings.adopt(*this));
    }
    /**
     * Take over the inertia that the integrator gives to bodies and free particles: its inertia
     * scale, if the scheme has momenta, and the held ones, which no force can move. Call this
     * before anything that reads momenta.
     */
    void adoptInertia();
    /** How often the held bodies or particles have changed. */
    int numHeldChanges() const { return heldChanges; }

    /** The Context's periodic box at present. @throws OpenMMException if it is not finite */
    BoxVectors getBox() const;

    /** The prescribed velocities of bodies at the present time; null without such bodies. */
    const Eigen::MatrixXd* prescribedNow();

    /** Whether positions were set since Forces::checkEnergy() has looked. */
    bool energyIsUnchecked = true;
    /**
     * Note that others changed positions, box or parameters, so that earlier forces are no longer
     * valid.
     */
    void noteChange() { changes++; }
    /** The number of such changes. */
    long long numChanges() const { return changes; }

    const CustomRigidHIIntegrator& integrator;
    const OpenMM::System& system;
    const std::map<std::string, double>& contextParameters;
    const bool forcesAreExact;  // in double precision
    const std::unique_ptr<ContextArrays> arrays;
    const std::unique_ptr<PlatformLoops> loops;
    BodyDefinitions definitions;
    SystemInventory stock;
    BodyForces bodyForces;
    BodyMotions bodyMotions;
    BodySet bodies;
    std::unique_ptr<FreeParticles> freeParticles;
    ContextFluid fluid;
    /** The noise, with the seed and the number of the next or present step. */
    AdoptedSettings settings;
    NoiseHistory noiseHistory;
    WarningPrinter warnings;
    TemperatureWatch watch;
    StepCounters counters;
    /** The platform's own steps, if it has any. */
    const NativeSteps* native = nullptr;

private:
    void adoptHeld();
    std::vector<bool> withoutMomenta() const;
    bool built = false;
    long long changes = 0;
    int heldChanges = 0;
    Eigen::MatrixXd prescribed;
    std::optional<int> adoptedHeld;  // the integrator's version of its settings
};

}  // namespace RigidHIPlugin

#endif
