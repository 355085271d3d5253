#include "fluid/Fluid.h"

#include <algorithm>
#include <sstream>

#include "fluid/GroupBuilder.h"
#include "mobility/models/periodic/Lattice.h"
#include "openmmrigidhi/internal/Errors.h"

using namespace std;

namespace RigidHIPlugin {

void Fluid::check(const MobilityForce& force, const FluidSettings& settings,
                  const OpenMM::System& system, const vector<vector<int>>& particlesOfBodies,
                  const FreeParticles& freeParticles, PlatformLoops& loops) {
    GroupBuilder(force, settings, system, particlesOfBodies, freeParticles, loops).checkModels();
}

Fluid::Fluid(const MobilityForce& force, const FluidSettings& settings,
             const OpenMM::System& system, const vector<vector<int>>& particlesOfBodies,
             const vector<BodyGeometry>& geometries, const BodySet& bodies,
             const FreeParticles& freeParticles, PlatformLoops& loops)
    : contents(force, settings, system, particlesOfBodies, geometries, bodies, freeParticles,
               loops) {}

bool Fluid::isMadeFor(const FluidSettings& wanted) const {
    const FluidSettings& own = contents.settings;
    if (contents.hasWalls() && own.wallRejection != wanted.wallRejection) return false;
    if (!own.holdsAs(wanted) || !own.joinsAs(wanted)) return false;
    if (own.scheme == wanted.scheme) return true;
    return none_of(contents.groups.begin(), contents.groups.end(),
                   [](const unique_ptr<FluidGroup>& group) { return group->dependsOnScheme; });
}

void Fluid::setMotorRates(const vector<HingeMotorDefinition>& motors) {
    for (const auto& group : contents.groups)
        if (group->joints) group->brownian->setMotorRates(motors);
}

void Fluid::continueFrom(const Fluid& before) {
    costs.continueFrom(before.costs);
    memory.continueFrom(before.memory);
}

void Fluid::setBox(const BoxVectors& box) {
    contents.setBox(box);
    boxIsChecked = false;
    flowReader.forget();
}

/** The box, with a vector across walls that is longer than any other, because the fluid has no
 * period there. */
static BoxVectors periodsOf(const BoundaryTraits& boundary, BoxVectors box) {
    if (!boundary.hasWalls()) return box;
    double longest = 0;
    for (const OpenMM::Vec3& vector : box) longest = max(longest, sqrt(vector.dot(vector)));
    box[boundary.wallAxis] = OpenMM::Vec3();
    box[boundary.wallAxis][boundary.wallAxis] = 2 * longest;
    return box;
}

void Fluid::checkBox() {
    if (!contents.isPeriodic() || boxIsChecked) return;
    const BoundaryTraits& boundary = traitsOf(contents.force.getBoundary());
    const Lattice lattice(periodsOf(boundary, contents.box));
    const double rounding = 1e-12, shortest = lattice.getShortest();
    for (const auto& group : contents.groups)
        for (size_t e = 0; e < group->bodies.getElements().size(); e++) {
            const FluidElement& element = group->bodies.getElements()[e];
            const double length = element.particles.empty() ? 0 : group->bodies.length(e);
            if (length <= shortest * (1 + rounding)) continue;
            ostringstream text;
            text << nameOf(element) << " has the length " << length
                 << " nm, hydrodynamic radii included, and would overlap its own image: in "
                 << textOf(contents.box) << " the shortest lattice vector has the length "
                 << shortest
                 << " nm; make the box larger by setPeriodicBoxVectors() on the Context (or "
                    "setDefaultPeriodicBoxVectors() on the System before)";
            // With walls another boundary would be another fluid.
            if (!boundary.hasWalls()) text << ", or use the boundary Unbounded";
            failFluid(text.str());
        }
    for (const auto& group : contents.groups)
        if (const BoxOfModel* box = group->box()) box->check(contents.box);
    checkWave();
    boxIsChecked = true;
}

void Fluid::checkWave() const {
    const UserFlow& flow = contents.userFlow;
    if (!flow.hasWave()) return;
    for (const auto& group : contents.groups)
        if (const BoxOfModel* box = group->box())
            box->checkWave(contents.box, flow.waveAxis, flow.waveVectorIndex);
}

}  // namespace RigidHIPlugin
