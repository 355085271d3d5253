#include "stepping/Rejections.h"

#include "context/Messages.h"
#include "context/Scene.h"

using namespace std;

namespace RigidHIPlugin {

void Rejections::count(int number, int attempts, const string& objection) {
    scene.counters.rejectedSteps += number;
    const int limit = scene.integrator.getMaximumRejections();
    if (scene.settings.kT > 0 && attempts <= limit) return;
    const string step = "step " + to_string(scene.arrays->getStepCount() + 1) + ": ",
                 where = step + objection;
    // Schemes that need no mobility at the start have not checked the poses there.
    const string atStart =
        scene.fluid->getChecks().objection(scene.bodies, scene.arrays->positions());
    if (!atStart.empty())
        fail(step + "the step starts at positions where the model has no mobility: " + atStart);
    if (scene.settings.kT == 0)
        fail(where +
             "; at temperature 0 there is no noise, so that redoing the step cannot help: take a "
             "smaller step, or add a repulsion");
    fail(where + "; the step was redone " + to_string(limit) +
         " times in a row, as often as setMaximumRejections() allows: take a smaller step, "
         "which also resolves stiffer forces, or keep particles apart by a repulsion of longer "
         "range");
}

}  // namespace RigidHIPlugin
