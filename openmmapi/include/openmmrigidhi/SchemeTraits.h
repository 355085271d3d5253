#ifndef OPENMMRIGIDHI_SCHEME_TRAITS_H_
#define OPENMMRIGIDHI_SCHEME_TRAITS_H_

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/internal/SchemeList.h"

namespace RigidHIPlugin {

/** What a scheme is made of, and which code runs it. */
enum class SchemeKind {
    Thermostat,       // moves and forces in turn, without a fluid
    FluidThermostat,  // moves and forces in turn, with the fluid in the middle of the step
    Overdamped        // without momenta, in a fluid
};

/**
 * The results that a scheme takes finite differences of. Finite differences magnify the errors of
 * results of iterations.
 */
enum class Differenced { Nothing, Products, Solves, Roots };

/** What is known of a scheme without running it. SchemeList.h explains each member. */
struct SchemeTraits {
    CustomRigidHIIntegrator::Scheme scheme;
    const char* name;
    SchemeKind kind;
    bool hasMomenta;
    int weakOrder, coldOrder, forces;
    Differenced differenced;
    const char *drift, *description;

    /** Whether the scheme needs a MobilityForce. */
    constexpr bool needsFluid() const { return kind != SchemeKind::Thermostat; }
    constexpr bool isOverdamped() const { return kind == SchemeKind::Overdamped; }
    /** Whether the scheme has a stochastic drift to make and does not make it. */
    constexpr bool omitsDrift() const { return isOverdamped() && *drift == 0; }
};

/** All schemes, in the order of their numbers. */
constexpr SchemeTraits schemeTable[] = {
#define RIGIDHI_ROW(name, kind, momenta, weakOrder, coldOrder, forces, differenced, drift, \
                    description)                                                           \
    {                                                                                      \
        CustomRigidHIIntegrator::name,                                                     \
        #name,                                                                             \
        SchemeKind::kind,                                                                  \
        momenta,                                                                           \
        weakOrder,                                                                         \
        coldOrder,                                                                         \
        forces,                                                                            \
        Differenced::differenced,                                                          \
        drift,                                                                             \
        description},
    RIGIDHI_SCHEMES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
};

constexpr const SchemeTraits& traitsOf(CustomRigidHIIntegrator::Scheme scheme) {
    return schemeTable[scheme];
}

}  // namespace RigidHIPlugin

#endif
