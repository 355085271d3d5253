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
        if (auto* nonbonded = dynamic_cast<const NonbondedForce*>(&force)) {
            note(nonbonded->getReciprocalSpaceForceGroup());
            note(nonbonded->getIncludeDirectSpace());
        }
    }
    return differs;
}

void ForceChoice::note(int number) {
    // The list grows at the first call, and where a Force was added to the System meanwhile.
    if (next == (int)last.size()) last.push_back(~number);
    differs = differs || last[next] != number;
    last[next++] = number;
}

}  // namespace RigidHIPlugin
