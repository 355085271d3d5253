#ifndef OPENMMRIGIDHI_SCHEME_TRAITS_H_
#define OPENMMRIGIDHI_SCHEME_TRAITS_H_

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/internal/SchemeList.h"

namespace RigidHIPlugin {

/** The parts of a scheme, which decide what code runs it. */
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

/**
 * What a step asks of the mobility of particles. With dense matrices the time of a step is that of
 * `matrices`; on a grid it is that of the other members.
 */
struct SchemeWork {
    int solves = 0;    // of mobility problems
    int fields = 0;    // random fields on a grid
    int roots = 0;     // square roots of the whole mobility, which iterations find on a grid
    int matrices = 0;  // formed and factorised without a grid
    // What bodies with a stochastic drift add. Where a scheme differences roots and a random field
    // is not one flow, each of these matrices also stands for a field.
    int driftSolves = 0, driftMatrices = 0;
    int driftMatricesOfBody = 0;  // for each body

    constexpr SchemeWork() {}
    constexpr SchemeWork(int solves, int fields, int roots, int matrices, int driftSolves = 0,
                         int driftMatrices = 0, int driftMatricesOfBody = 0)
        : solves(solves), fields(fields), roots(roots), matrices(matrices),
          driftSolves(driftSolves), driftMatrices(driftMatrices),
          driftMatricesOfBody(driftMatricesOfBody) {}
};

/** The properties of a scheme. SchemeList.h explains each member. */
struct SchemeTraits {
    CustomRigidHIIntegrator::Scheme scheme;
    const char* name;
    SchemeKind kind;
    bool hasMomenta;
    int weakOrder, coldOrder, forces;
    Differenced differenced;
    SchemeWork work;
    const char *drift, *description;

    /** Whether the scheme needs a MobilityForce. */
    constexpr bool needsFluid() const { return kind != SchemeKind::Thermostat; }
    constexpr bool isOverdamped() const { return kind == SchemeKind::Overdamped; }
    /** Whether the scheme should make a stochastic drift but does not. */
    constexpr bool omitsDrift() const { return isOverdamped() && *drift == 0; }
    /**
     * Whether products may be iterations. Otherwise the scheme takes matrices where each product
     * iterates, as with lubrication on top of a model.
     */
    constexpr bool takesIterations() const {
        return kind != SchemeKind::FluidThermostat && differenced != Differenced::Roots;
    }
    /** Why the scheme cannot have joints between bodies; empty: it can. */
    constexpr const char* whyNoJoints() const {
        using RigidHI = CustomRigidHIIntegrator;
        if (hasMomenta) return "joints with momenta sample another measure";
        if (!needsFluid()) return "joints need the mobility of a fluid";
        if (omitsDrift()) return "without the drift of jointed bodies it samples another measure";
        if (scheme == RigidHI::DriftCorrectorFD || scheme == RigidHI::DriftCorrectorRFD)
            return "its mid-point tears joints";
        const bool hasJoints = scheme == RigidHI::FixmanMidpoint ||
                               scheme == RigidHI::RandomFiniteDifference ||
                               scheme == RigidHI::TrapezoidalSlip;
        return hasJoints ? "" : "its drift leaves out how joints turn";
    }
};

/** All schemes, in the order of their numbers. */
constexpr SchemeTraits schemeTable[] = {
#define RIGIDHI_ROW(name, kind, momenta, weakOrder, coldOrder, forces, differenced, work, drift, \
                    description)                                                                 \
    {CustomRigidHIIntegrator::name,                                                              \
     #name,                                                                                      \
     SchemeKind::kind,                                                                           \
     momenta,                                                                                    \
     weakOrder,                                                                                  \
     coldOrder,                                                                                  \
     forces,                                                                                     \
     Differenced::differenced,                                                                   \
     SchemeWork work,                                                                            \
     drift,                                                                                      \
     description},
    RIGIDHI_SCHEMES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
};

constexpr const SchemeTraits& traitsOf(CustomRigidHIIntegrator::Scheme scheme) {
    return schemeTable[scheme];
}

}  // namespace RigidHIPlugin

#endif
