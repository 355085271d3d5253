#include "context/ActingForces.h"

#include <OpenMM.h>
#include <cxxabi.h>

#include <cstdlib>
#include <memory>
#include <set>
#include <typeinfo>

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

/** The name of a Force's class, without the namespace OpenMM. */
std::string className(const Force& force) {
    int status = 0;
    const std::unique_ptr<char, decltype(&std::free)> name(
        abi::__cxa_demangle(typeid(force).name(), nullptr, nullptr, &status), std::free);
    const std::string all = status == 0 ? name.get() : typeid(force).name(), space = "OpenMM::";
    return all.compare(0, space.size(), space) == 0 ? all.substr(space.size()) : all;
}

/**
 * Kinds that only make forces, of OpenMM's own plugins and of other versions of OpenMM. This
 * library does not link to their classes.
 */
const std::set<std::string> kindsByName = {"AmoebaGeneralizedKirkwoodForce",
                                           "AmoebaMultipoleForce",
                                           "AmoebaTorsionTorsionForce",
                                           "AmoebaVdwForce",
                                           "AmoebaWcaDispersionForce",
                                           "ATMForce",
                                           "CustomVolumeForce",
                                           "DrudeForce",
                                           "HippoNonbondedForce"};

/** Whether OpenMM's updateContextState() does nothing for this Force. */
bool onlyMakesForces(const Force& force) {
    if (kindsByName.count(className(force))) return true;
    return isOneOf<CMAPTorsionForce, CustomAngleForce, CustomBondForce, CustomCVForce,
                   CustomCentroidBondForce, CustomCompoundBondForce, CustomExternalForce,
                   CustomGBForce, CustomHbondForce, CustomManyParticleForce, CustomNonbondedForce,
                   CustomTorsionForce, GayBerneForce, GBSAOBCForce, HarmonicAngleForce,
                   HarmonicBondForce, NonbondedForce, PeriodicTorsionForce, RBTorsionForce,
                   RMSDForce, CustomBodyForce, CustomBodyMotion, MobilityForce>(force);
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
            other = className(force);
    }
}

}  // namespace RigidHIPlugin
