#include "fluid/FluidContents.h"

#include <sstream>

#include "fluid/GroupBuilder.h"
#include "linearalgebra/OneBlasThread.h"

using namespace std;

namespace RigidHIPlugin {

string textOf(const BoxVectors& box) {
    ostringstream text;
    text << "the periodic box";
    for (int k = 0; k < 3; k++)
        text << (k == 0 ? " (" : ", (") << box[k][0] << ", " << box[k][1] << ", " << box[k][2]
             << ")";
    text << " nm";
    return text.str();
}

FluidContents::FluidContents(const MobilityForce& forceToUse, const FluidSettings& settings,
                             const OpenMM::System& system,
                             const vector<vector<int>>& particlesOfBodiesToUse,
                             const vector<BodyGeometry>& geometries, const BodySet& bodies,
                             const FreeParticles& freeParticles, PlatformLoops& loops)
    : force(forceToUse), userFlow(force), settings(settings), loops(loops),
      particlesOfBodies(particlesOfBodiesToUse),
      groups(GroupBuilder(force, settings, system, particlesOfBodies, freeParticles, loops)
                 .build(geometries, bodies)),
      elementOfBody(particlesOfBodies.size(), -1), groupOfBody(particlesOfBodies.size(), -1),
      groupOfFree(freeParticles.getNumParticles(), -1) {
    for (size_t g = 0; g < groups.size(); g++) {
        const FluidGroup& group = *groups[g];
        const auto& elements = group.bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++)
            if (elements[e].isFree()) {
                groupOfFree[group.members.freeIndex[e]] = g;
            } else {
                groupOfBody[elements[e].body] = g;
                elementOfBody[elements[e].body] = e;
            }
    }
}

void FluidContents::setBox(const BoxVectors& newBox) {
    findHolds();  // of a step in the old box
    box = newBox;
    for (const auto& group : groups) {
        group->bodies.setBox(box);
        group->brownian->setBox(box);
    }
    flow = userFlow.inBox(box);
    isDriven = !flow.isZero();
}

void FluidContents::findHolds() const {
    const OneBlasThread single;
    for (const auto& group : groups)
        if (group->holds) group->holds->find();
}

void FluidContents::forGroups(int count, double operations, const function<void(int)>& task) const {
    // Waking the threads takes about 1e-4 s (benchmarks/README.md).
    const double worthThreads = 1e6;
    if (count > 1 && operations > worthThreads)
        loops.forTasks(count, task);
    else
        for (int i = 0; i < count; i++) task(i);
}

}  // namespace RigidHIPlugin
