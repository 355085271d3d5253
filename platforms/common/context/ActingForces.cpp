#include "context/ActingForces.h"

#include <OpenMM.h>

#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;

namespace RigidHIPlugin {

namespace {

template <class... Kinds>
bool isOneOf(const Force& force) {
    return (... || (dynamic_cast<const Kinds*>(&force) != nullptr));
}

/** Whether OpenMM's updateContextState() does nothing for this Force. */
bool onlyMakesForces(const Force& force) {
    return isOneOf<CMAPTorsionForce, CustomAngleForce, CustomBondForce, CustomCentroidBondForce,
                   CustomCompoundBondForce, CustomExternalForce, CustomGBForce, CustomHbondForce,
                   CustomManyParticleForce, CustomNonbondedForce, CustomTorsionForce, GayBerneForce,
                   GBSAOBCForce, HarmonicAngleForce, HarmonicBondForce, NonbondedForce,
                   PeriodicTorsionForce, RBTorsionForce, RMSDForce, CustomBodyForce,
                   CustomBodyMotion, MobilityForce>(force);
}

}  // namespace

bool feelsNoParticles(const Force& force) {
    return isOneOf<CMMotionRemover, MonteCarloBarostat, MonteCarloAnisotropicBarostat,
                   MonteCarloMembraneBarostat, CustomBodyForce, CustomBodyMotion, MobilityForce>(
        force);
}

ActingForces::ActingForces(const System& system) {
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        if (isOneOf<CMMotionRemover>(force))
            removers = true;
        else if (isOneOf<MonteCarloBarostat, MonteCarloAnisotropicBarostat,
                         MonteCarloMembraneBarostat>(force))
            barostats = true;
        else if (!onlyMakesForces(force))
            others = true;
    }
}

}  // namespace RigidHIPlugin
