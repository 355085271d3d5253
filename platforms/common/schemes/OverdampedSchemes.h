#ifndef RIGIDHI_OVERDAMPED_SCHEMES_H_
#define RIGIDHI_OVERDAMPED_SCHEMES_H_

#include <memory>
#include <vector>

#include "openmmrigidhi/SchemeTraits.h"
#include "rigid/SlowedSpin.h"
#include "schemes/OverdampedScheme.h"

namespace RigidHIPlugin {

/** How the engine runs a scheme of the kind Overdamped. */
struct OverdampedEntry {
    std::vector<double> forcesAt;  // OverdampedScheme
    std::unique_ptr<OverdampedScheme> (*make)();
    SpinBounds spins = boundsOfStart;

    int numStages() const { return forcesAt.size(); }
    bool needsForces(int stage) const { return forcesAt[stage] >= 0; }
    int numForceEvaluations() const {
        int number = 0;
        for (int stage = 0; stage < numStages(); stage++) number += needsForces(stage);
        return number;
    }
};

/**
 * The entry of a scheme of the kind Overdamped. CMake finds the schemes, which are all files in
 * schemes/overdamped.
 */
const OverdampedEntry& overdampedScheme(CustomRigidHIIntegrator::Scheme scheme);

}  // namespace RigidHIPlugin

#endif
