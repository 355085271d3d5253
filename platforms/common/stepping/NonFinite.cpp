#include "stepping/NonFinite.h"

#include <cmath>
#include <string>

#include "context/Messages.h"
#include "context/Scene.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

void reportNonFinite(Scene& scene, const char* what) {
    const string where = "step " + to_string(scene.arrays->getStepCount() + 1) + ": ",
                 remedy =
                     "; the Context keeps the state before this step: look there for overlapping "
                     "particles, or take a smaller step";
    const BodySet& bodies = scene.bodies;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const BodyState state = bodies.getState(b);
        const bool pose =
            isFinite(state.R) && isfinite(state.q[0] + state.q[1] + state.q[2] + state.q[3]);
        if (pose && isFinite(bodies.getForce_lab(b)) && isFinite(bodies.getTorque_lab(b)) &&
            isFinite(state.p) && isFinite(state.l))
            continue;
        fail(where + "body " + to_string(b) + " (first particle " +
             to_string(scene.definitions.particles(b)[0]) + ") has a non-finite " +
             (pose ? "force, torque or momentum" : "position or orientation") + remedy);
    }
    const FreeParticles& free = *scene.freeParticles;
    for (int i = 0; i < free.getNumParticles(); i++) {
        const int p = free.getParticles()[i];
        if (!isFinite(free.getForce(i)) || !isFinite(scene.arrays->positions()[p]) ||
            !isFinite(scene.arrays->velocities()[p]))
            fail(where + "free particle " + to_string(p) + " has a non-finite " + what +
                 " or velocity" + remedy);
    }
    fail(where + "a non-finite " + what + " was found" + remedy);
}

}  // namespace RigidHIPlugin
