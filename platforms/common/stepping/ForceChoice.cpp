#include "stepping/ForceChoice.h"

#include <openmm/NonbondedForce.h>
#include <openmm/System.h>

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

bool ForceChoice::changed(const System& system, int integrationForceGroups) {
    next = 0;
    differs = false;
    note(integrationForceGroups);
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        note(force.getForceGroup());
        if (isNonbonded(i, force)) {
            const auto& nonbonded = static_cast<const NonbondedForce&>(force);
            note(nonbonded.getReciprocalSpaceForceGroup());
            note(nonbonded.getIncludeDirectSpace());
        }
    }
    return differs;
}

bool ForceChoice::isNonbonded(int index, const Force& force) {
    if (index >= (int)kinds.size()) kinds.resize(index + 1);
    Kind& kind = kinds[index];
    // A dynamic_cast of every Force in every step would take longer than the step of a single body.
    if (kind.type != &typeid(force))
        kind = {&typeid(force), dynamic_cast<const NonbondedForce*>(&force) != nullptr};
    return kind.isNonbonded;
}

void ForceChoice::note(int number) {
    // The list grows at the first call, and after a Force was added to the System.
    if (next == (int)last.size()) last.push_back(~number);
    differs = differs || last[next] != number;
    last[next++] = number;
}

}  // namespace RigidHIPlugin
