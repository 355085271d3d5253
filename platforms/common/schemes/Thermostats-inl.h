// The class of a scheme, from its enumerator. CMake finds the schemes, which are all files in
// schemes/thermostats.

#if defined(RIGIDHI_THERMOSTATS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_THERMOSTATS_INL_H_
#undef RIGIDHI_THERMOSTATS_INL_H_
#else
#define RIGIDHI_THERMOSTATS_INL_H_
#endif

#include <stdexcept>

#include "openmmrigidhi/SchemeTraits.h"
#include "schemes/AllThermostats-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

/** Call action(S()) for the scheme S of this name, of the kinds Thermostat and FluidThermostat. */
template <class Action>
inline auto withThermostat(CustomRigidHIIntegrator::Scheme scheme, Action action) {
    switch (scheme) {
#define RIGIDHI_CASE_Thermostat(name)   \
    case CustomRigidHIIntegrator::name: \
        return action(name());
#define RIGIDHI_CASE_FluidThermostat(name) RIGIDHI_CASE_Thermostat(name)
#define RIGIDHI_CASE_Overdamped(name)   \
    case CustomRigidHIIntegrator::name: \
        break;
#define RIGIDHI_ROW(name, kind, ...) RIGIDHI_CASE_##kind(name)
        RIGIDHI_SCHEMES(RIGIDHI_ROW)
#undef RIGIDHI_CASE_Thermostat
#undef RIGIDHI_CASE_FluidThermostat
    }
    throw std::logic_error("a scheme without momenta in a fluid runs by OverdampedSchemes.h");
}

/** Call action(S()) for a scheme of the kind FluidThermostat. */
template <class Action>
inline auto withFluidThermostat(CustomRigidHIIntegrator::Scheme scheme, Action action) {
    switch (scheme) {
#define RIGIDHI_CASE_Thermostat(name) RIGIDHI_CASE_Overdamped(name)
#define RIGIDHI_CASE_FluidThermostat(name) \
    case CustomRigidHIIntegrator::name: return action(name());
        RIGIDHI_SCHEMES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
#undef RIGIDHI_CASE_Thermostat
#undef RIGIDHI_CASE_FluidThermostat
#undef RIGIDHI_CASE_Overdamped
    }
    throw std::logic_error("the scheme has no part between the fluid's");
}

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
