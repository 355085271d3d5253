#include "schemes/OverdampedSchemes.h"

#include "schemes/DriftCorrector.h"
#include "schemes/EulerMaruyama.h"
#include "schemes/FixmanMidpoint.h"
#include "schemes/RandomFiniteDifference.h"
#include "schemes/TractionEulerMaruyama.h"
#include "schemes/TrapezoidalSlip.h"

namespace RigidHIPlugin {

namespace {

template <class Scheme>
OverdampedScheme entry(const char* name) {
    OverdampedScheme scheme = {
        name,    Scheme::drift,    Scheme::differenced, Scheme::forcesAtStart, Scheme::forcesInBetween,
        nullptr, &Scheme::predict, &Scheme::correct};
    if constexpr (Scheme::forcesInBetween) scheme.timeOfForces = &Scheme::timeOfForces;
    return scheme;
}

}  // namespace

const OverdampedScheme& overdampedScheme(CustomRigidHIIntegrator::Scheme scheme) {
    // In the order of CustomRigidHIIntegrator::Scheme.
    static const OverdampedScheme schemes[] = {entry<EulerMaruyama>("EulerMaruyama"),
                                               entry<FixmanMidpoint>("FixmanMidpoint"),
                                               entry<RandomFiniteDifference>("RandomFiniteDifference"),
                                               entry<TractionEulerMaruyama>("TractionEulerMaruyama"),
                                               entry<TrapezoidalSlip>("TrapezoidalSlip"),
                                               entry<DriftCorrectorFD>("DriftCorrectorFD"),
                                               entry<DriftCorrectorRFD>("DriftCorrectorRFD")};
    return schemes[scheme - CustomRigidHIIntegrator::EulerMaruyama];
}

}  // namespace RigidHIPlugin
