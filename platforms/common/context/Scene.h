#ifndef RIGIDHI_SCENE_H_
#define RIGIDHI_SCENE_H_

#include <openmm/System.h>
#include <openmm/internal/ContextImpl.h>

#include <memory>
#include <vector>

#include "context/BodyDefinitions.h"
#include "context/ContextArrays.h"
#include "context/ContextFluid.h"
#include "context/SystemCheck.h"
#include "forces/BodyForces.h"
#include "host/PlatformLoops.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "rigidbody/BodySet.h"
#include "stepping/CurrentSettings.h"
#include "stepping/FreeParticles.h"
#include "stepping/StepCounters.h"

namespace RigidHIPlugin {

/** What moves in one Context: bodies, free particles, the fluid between them, and the settings by
 * which steps are taken. */
class Scene {
public:
    /** Check the System against the integrator (throws where it is refused), and make what needs no
     * positions. */
    Scene(OpenMM::ContextImpl& context, const CustomRigidHIIntegrator& integrator,
          std::unique_ptr<ContextArrays> arrays, std::unique_ptr<PlatformLoops> loops);
    Scene(const Scene&) = delete;

    /**
     * Make everything that stands on the geometries of the bodies, or throw and leave it as it was.
     * States stay at the origin until positions are taken in.
     */
    void build(const std::vector<BodyGeometry>& geometries);
    /** Likewise where some geometries come from positions. They are known when everything that
     * stands on them is made. */
    void buildFromPositions();
    /** Implicit geometries are to be found anew. */
    void resetGeometry();
    /** Whether build() was done, and resetGeometry() was not called since. */
    bool isBuilt() const { return built; }
    /** Recompute what depends on settings, if any was changed. */
    void updateSettings() { settings.update(*this); }
    /** The integrator's inertia scale holds from now on, if the scheme has momenta: before anything
     * that looks at momenta. */
    void adoptInertiaScale();

    /** The Context's periodic box at present. */
    BoxVectors getBox() const;

    /** Forces that were evaluated before do not serve any more: others changed positions, box or
     * parameters. */
    void noteChange() { changes++; }
    /** How many such changes there were. */
    long long numChanges() const { return changes; }

    const CustomRigidHIIntegrator& integrator;
    const OpenMM::System& system;
    const std::unique_ptr<ContextArrays> arrays;
    const std::unique_ptr<PlatformLoops> loops;
    BodyDefinitions definitions;
    SystemInventory stock;
    BodyForces bodyForces;
    BodySet bodies;
    std::unique_ptr<FreeParticles> freeParticles;
    ContextFluid fluid;
    /** Its noise has the seed, and the number of the step that is next or in progress. */
    CurrentSettings settings;
    StepCounters counters;

private:
    bool built = false;
    long long changes = 0;
};

}  // namespace RigidHIPlugin

#endif
