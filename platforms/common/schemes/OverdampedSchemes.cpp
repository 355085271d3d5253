#include "schemes/OverdampedSchemes.h"

#include "schemes/AllOverdamped.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

template <class Scheme>
OverdampedEntry entry() {
    return {vector<double>(Scheme::forcesAt.begin(), Scheme::forcesAt.end()),
            []() -> unique_ptr<OverdampedScheme> { return make_unique<Scheme>(); },
            Scheme::hasMobilityOfMidpoint ? boundsOfMidpoint : boundsOfStart};
}

}  // namespace

const OverdampedEntry& overdampedScheme(CustomRigidHIIntegrator::Scheme scheme) {
    // Entries by the number of the scheme. Schemes of other kinds have an empty entry.
    static const OverdampedEntry entries[] = {
#define RIGIDHI_ENTRY_Thermostat(name) OverdampedEntry()
#define RIGIDHI_ENTRY_FluidThermostat(name) OverdampedEntry()
#define RIGIDHI_ENTRY_Overdamped(name) entry<name>()
#define RIGIDHI_ROW(name, kind, ...) RIGIDHI_ENTRY_##kind(name),
        RIGIDHI_SCHEMES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
    };
    return entries[scheme];
}

}  // namespace RigidHIPlugin
