// RigidBodyKernel: saving and resuming.

#include <openmm/OpenMMException.h>
#include <openmm/serialization/SerializationNode.h>

#include <cmath>
#include <sstream>

#include "engine/RigidBodyKernel.h"
#include "engine/StateHash.h"
#include "rigidbody/EigenVec3.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

[[noreturn]] void fail(const string& message) { throw OpenMMException("CustomRigidHIIntegrator: " + message); }

/** Masses and moments that agree to this are the same number, computed or printed in another way. */
const double definitionTolerance = 1e-9;

bool agree(double a, double b, double scale) {
    return abs(a - b) <= definitionTolerance * max(a, b) + zeroMomentFraction * scale;
}

string text(double x) {
    ostringstream stream;
    stream.precision(10);
    stream << x;
    return stream.str();
}

string text(const Vec3& v) { return "(" + text(v[0]) + ", " + text(v[1]) + ", " + text(v[2]) + ")"; }

}  // namespace

SavedState RigidBodyKernel::collectState(ContextImpl& context) {
    SavedState saved;
    saved.seed = seed;
    saved.stepNumber = stepNumber;
    if (!positionsAreSet) return saved;
    takeInChanges(context);
    saved.hasBodies = true;
    saved.positionsHash = hashOf(positions());
    saved.velocitiesHash = hashOf(velocities());
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const BodyState state = bodies.getState(b);
        SavedBody body;
        body.geometry = geometries[b];
        body.R = state.R;
        body.q = state.q;
        body.velocity = geometries[b].mass > 0 ? state.p / geometries[b].mass : Vec3();
        body.omega_lab = bodies.getAngularVelocity_lab(b);
        body.stored = bodies.getStoredState(b);
        saved.bodies.push_back(body);
    }
    if (fluid) saved.memory = fluid->getMemory();
    return saved;
}

/** An explicit body's definition is the integrator's; a state that was saved with another one is not its state. */
void RigidBodyKernel::checkAgainstDefinition(int b, const BodyGeometry& saved) const {
    const BodyGeometry& own = geometries[b];
    string difference;
    const double largest = max(own.moments[0], max(own.moments[1], own.moments[2]));
    bool sameMoments = true;
    for (int k = 0; k < 3; k++) sameMoments = sameMoments && agree(saved.moments[k], own.moments[k], largest);
    if (!agree(saved.mass, own.mass, 0))
        difference = "mass " + text(saved.mass) + " instead of " + text(own.mass) + " amu";
    else if (!sameMoments)
        difference = "moments " + text(saved.moments) + " instead of " + text(own.moments) + " amu nm^2";
    for (size_t i = 0; i < own.sites.size() && difference.empty(); i++) {
        const Vec3 off = saved.sites[i] - own.sites[i];
        if (!(sqrt(off.dot(off)) <= integrator->getPoseTolerance()))
            difference = "particle " + to_string(definitions->getRigidBodyParticles(b)[i]) + " at " +
                         text(saved.sites[i]) + " instead of " + text(own.sites[i]) + " nm";
    }
    if (difference.empty()) return;
    fail("body " + to_string(b) + " was saved with another shape or mass than this integrator gives it: " + difference +
         "; load the state into the integrator it was saved with, or (after setRigidBodyParameters()) call "
         "reinitialize() without preserveState and set positions and velocities again");
}

/**
 * What is saved goes on, bit for bit where a body's definition is the saved one. The System wins for bodies that were added by their
 * particles: what it now says of their masses and constraints holds, and pose and twist are fitted to the saved positions and velocities.
 * If anything is refused, everything stays as it was.
 */
void RigidBodyKernel::adoptState(const SavedState& saved) {
    const int n = definitions->getNumRigidBodies();
    if (saved.hasBodies) {
        if ((int)saved.bodies.size() != n)
            fail("the saved state has " + to_string(saved.bodies.size()) + " bodies, but this integrator has " +
                 to_string(n) + "; load it into an integrator with the same bodies");
        vector<BodyGeometry> now = geometries;
        vector<int> others;
        for (int b = 0; b < n; b++) {
            const BodyGeometry& g = saved.bodies[b].geometry;
            const vector<int>& particles = definitions->getRigidBodyParticles(b);
            if (g.sites.size() != particles.size())
                fail("body " + to_string(b) + ": the saved state has " + to_string(g.sites.size()) +
                     " particles for it, but this integrator has " + to_string(particles.size()) +
                     "; load it into an integrator with the same bodies");
            if (definitions->getRigidBodyIsExplicit(b))
                checkAgainstDefinition(b, g);
            else
                now[b] = BodyGeometryBuilder(*system, *constraints, particles, "body " + to_string(b)).update(g);
            if (!sameGeometry(now[b], g)) others.push_back(b);
        }
        if (positionsAreSet) checkPosesAgainstPositions(saved);
        buildBodies(now);
        for (int b = 0; b < n; b++) {
            if (!definitions->getRigidBodyIsExplicit(b)) recordGeometry(b, now[b]);
            bodies.setStoredState(b, saved.bodies[b].stored);
        }
        for (int b : others) {
            BodyState state;
            state.R = saved.bodies[b].R;
            state.q = saved.bodies[b].q;
            state.p = saved.bodies[b].velocity * now[b].mass;
            bodies.setState(b, state);
            bodies.setAngularVelocity_lab(b, saved.bodies[b].omega_lab);
        }
        if (fluid) fluid->setMemory(saved.memory, integrator->getScheme());
        compareByHash = true;
        loaded.reset(new SavedState(saved));
        bodiesOfOtherDefinition = others;
        forcesAreValid = false;
        // Arrays that are not the saved ones count as changed by the user.
        lastPositions.assign(lastPositions.size(), unsetVec3);
        lastVelocities = lastPositions;
    }
    seed = saved.seed;
    stepNumber = saved.stepNumber;
}

/** Where the Context's positions are those of a saved state, its poses must be theirs: else it was damaged or edited. */
void RigidBodyKernel::checkPosesAgainstPositions(const SavedState& saved) {
    if (hashOf(positions()) != saved.positionsHash) return;
    for (size_t b = 0; b < saved.bodies.size(); b++) {
        const SavedBody& body = saved.bodies[b];
        const Eigen::Quaterniond q(body.q[0], body.q[1], body.q[2], body.q[3]);
        const vector<int>& particles = definitions->getRigidBodyParticles(b);
        for (size_t i = 0; i < particles.size(); i++) {
            // Virtual sites follow the others, and may not have done so yet.
            if (system->isVirtualSite(particles[i])) continue;
            const Vec3 place = body.R + toVec3(q * toEigen(body.geometry.sites[i])),
                       off = positions()[particles[i]] - place;
            const double distance = sqrt(off.dot(off)), tolerance = integrator->getPoseTolerance();
            if (!(distance <= tolerance))
                fail("body " + to_string(b) + ": the saved state is corrupt: particle " + to_string(particles[i]) +
                     " is " + text(distance) + " nm from where the saved pose puts it, more than the pose tolerance " +
                     text(tolerance) + " nm; use another");
        }
    }
}

void RigidBodyKernel::createCheckpoint(ContextImpl& context, ostream& stream) { collectState(context).write(stream); }

void RigidBodyKernel::loadCheckpoint(ContextImpl& context, istream& stream) { adoptState(SavedState::read(stream)); }

void RigidBodyKernel::serialize(ContextImpl& context, SerializationNode& node) { collectState(context).write(node); }

void RigidBodyKernel::deserialize(ContextImpl& context, const SerializationNode& node) {
    // A State that was saved under an integrator without parameters carries none: its positions and velocities serve.
    if (node.getChildren().empty() && node.getProperties().empty()) return;
    for (const SerializationNode& child : node.getChildren())
        if (child.getName() == "RigidBodyState") {
            adoptState(SavedState::read(child));
            return;
        }
    fail(
        "the State's integrator parameters belong to another integrator; save it without them (in Python: "
        "getState(getIntegratorParameters=False)), or load it under the integrator it was saved with");
}

}  // namespace RigidHIPlugin
