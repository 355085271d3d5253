#include "forces/BodyForces.h"

#include <cmath>
#include <set>

#include "forces/CompiledExpressions.h"
#include "openmmrigidhi/internal/CustomBodyForceImpl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

// The first places of position, orientation, velocity and time among the variables of a
// CustomBodyForce.
const int X = 0, Q = 3, V = 7, T = 10;

}  // namespace

/** One CustomBodyForce. */
struct BodyForces::Force : CompiledExpressions {
    Force(int index, const CustomBodyForceImpl& impl)
        : CompiledExpressions(index, impl), owner(impl.getOwner()) {
        for (const string& component : impl.getExpressions().getKind().components)
            compile(component);
    }
    const CustomBodyForce& owner;
    bool isIn(int groups) const {
        return (groups >> owner.getForceGroup() & 1) != 0 && !getBodies().empty();
    }
};

BodyForces::BodyForces() {}
BodyForces::~BodyForces() {}
BodyForces& BodyForces::operator=(BodyForces&&) = default;

BodyForces::BodyForces(ContextImpl& context) {
    const auto& impls = context.getForceImpls();
    for (size_t i = 0; i < impls.size(); i++) {
        const auto* impl = dynamic_cast<const CustomBodyForceImpl*>(impls[i]);
        if (impl == nullptr) continue;
        auto force = make_unique<Force>(i, *impl);
        time = time || force->uses(T, T + 1);
        velocities = velocities || force->uses(V, V + 3);
        forces.push_back(move(force));
    }
}

string BodyForces::velocityDependence() const {
    for (const auto& force : forces)
        if (force->uses(V, V + 3))
            return "force " + to_string(force->getForce()) + ", a CustomBodyForce";
    return "";
}

bool BodyForces::isOn(int groups) const {
    for (const auto& force : forces)
        if (force->isIn(groups)) return true;
    return false;
}

/**
 * Set the velocities that expressions use: those after a kick of this length, ps, with the present
 * forces on the bodies.
 */
void BodyForces::setVelocities(const BodySet& bodies, double lookAhead) {
    velocity.resize(bodies.getNumBodies());
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const int slot = bodies.slot(b);
        for (int k = 0; k < 3; k++)
            velocity[b][k] = bodies.inverseMass[slot] *
                             (bodies.p[k][slot] + lookAhead * bodies.force_lab[k][slot]);
    }
}

void BodyForces::addOnce(ContextImpl& context, BodySet& bodies, int groups, double t) {
    for (auto& force : forces) {
        if (!force->isIn(groups)) continue;
        force->setGlobals(context.getParameters());
        double* values = force->variables();
        values[T] = t;
        int entry = 0;
        for (int b : force->getBodies()) {
            const BodyState state = bodies.getState(b);
            for (int k = 0; k < 3; k++) values[X + k] = state.R[k];
            for (int k = 0; k < 4; k++) values[Q + k] = state.q[k];
            for (int k = 0; velocities && k < 3; k++) values[V + k] = velocity[b][k];
            force->setEntry(entry++);
            Vec3 wrench[2];
            for (int c = 0; c < 6; c++)
                if (!force->expressions()[c].isZero())
                    wrench[c / 3][c % 3] = force->expressions()[c].evaluate();
            bodies.addForceAndTorque_lab(b, wrench[0], wrench[1]);
        }
    }
}

bool BodyForces::add(ContextImpl& context, BodySet& bodies, int groups, double t,
                     double lookAhead) {
    if (velocities) {
        bodies.saveForces(before);
        setVelocities(bodies, 0);
    }
    addOnce(context, bodies, groups, t);
    if (velocities && lookAhead != 0) {
        // The forces at the present velocities predict the velocities ahead to second order.
        setVelocities(bodies, lookAhead);
        removeLast(bodies);
        addOnce(context, bodies, groups, t);
    }
    bool finite = true;
    for (int k = 0; k < 3; k++)
        for (size_t s = 0; s < bodies.bodyOfSlot.size(); s++)
            finite = finite && isfinite(bodies.force_lab[k][s]) && isfinite(bodies.torque[k][s]);
    return finite;
}

void BodyForces::removeLast(BodySet& bodies) const { bodies.restoreForces(before); }

string BodyForces::describe(int groups) const {
    if (forces.empty()) return "the System has no CustomBodyForce";
    set<int> acted;
    int on = 0;
    for (const auto& force : forces)
        if (force->isIn(groups)) {
            on++;
            acted.insert(force->getBodies().begin(), force->getBodies().end());
        }
    const auto number = [](int n, const char* one, const char* many) {
        return to_string(n) + " " + (n == 1 ? one : many);
    };
    if (on == 0)
        return "none of " + number(forces.size(), "CustomBodyForce", "CustomBodyForces") +
               " has bodies and is in an integrated force group";
    return number(acted.size(), "body", "bodies") + ", " +
           number(on, "CustomBodyForce", "CustomBodyForces") + (time ? ", depending on time" : "") +
           (velocities ? ", depending on velocities" : "");
}

}  // namespace RigidHIPlugin
