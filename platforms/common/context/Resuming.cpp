#include "context/Resuming.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "context/ContextMirror.h"
#include "context/Messages.h"
#include "context/StateHash.h"
#include "rigidbody/EigenVec3.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * Masses and moments that agree to this relative tolerance count as the same number, computed or
 * printed in another way.
 */
const double definitionTolerance = 1e-9;

bool agree(double a, double b, double scale) {
    return abs(a - b) <= definitionTolerance * max(a, b) + zeroMomentFraction * scale;
}

/**
 * Refuse a state whose definition of an explicit body differs from the integrator's.
 */
void checkAgainstDefinition(const Scene& scene, int b, const BodyGeometry& saved) {
    const BodyGeometry& own = scene.definitions.geometries()[b];
    string difference;
    const double largest = max(own.moments[0], max(own.moments[1], own.moments[2]));
    bool sameMoments = true;
    for (int k = 0; k < 3; k++)
        sameMoments = sameMoments && agree(saved.moments[k], own.moments[k], largest);
    if (!agree(saved.mass, own.mass, 0))
        difference = "mass " + text(saved.mass) + " instead of " + text(own.mass) + " amu";
    else if (!sameMoments)
        difference =
            "moments " + text(saved.moments) + " instead of " + text(own.moments) + " amu nm^2";
    for (size_t i = 0; i < own.sites.size() && difference.empty(); i++) {
        const Vec3 off = saved.sites[i] - own.sites[i];
        if (!(sqrt(off.dot(off)) <= scene.definitions.siteTolerance()))
            difference = "particle " + to_string(scene.definitions.particles(b)[i]) + " at " +
                         text(saved.sites[i]) + " instead of " + text(own.sites[i]) + " nm";
    }
    if (difference.empty()) return;
    fail("body " + to_string(b) +
         " was saved with another shape or mass than this integrator gives it: " + difference +
         "; load the state into the integrator that saved it, or (after "
         "setRigidBodyParameters()) call reinitialize() without preserveState and set positions "
         "and velocities again");
}

/** The present geometry of a body by its definition, its saved geometry and the present System. */
BodyGeometry geometryNow(const Scene& scene, int b, const BodyGeometry& saved) {
    const size_t particles = scene.definitions.particles(b).size();
    if (saved.sites.size() != particles)
        fail("body " + to_string(b) + ": the saved state has " + to_string(saved.sites.size()) +
             " particles for this body, but this integrator has " + to_string(particles) +
             "; load it into an integrator with the same bodies");
    if (!scene.definitions.isExplicit(b)) return scene.definitions.updateBySystem(b, saved);
    checkAgainstDefinition(scene, b, saved);
    return scene.definitions.geometries()[b];
}

void adoptBodies(const SavedState& saved, Scene& scene, ContextMirror& mirror) {
    const int n = scene.definitions.getNumBodies();
    if ((int)saved.bodies.size() != n)
        fail("the saved state has " + to_string(saved.bodies.size()) +
             " bodies, but this integrator has " + to_string(n) +
             "; load it into an integrator with the same bodies");
    vector<BodyGeometry> now;
    vector<int> others;
    for (int b = 0; b < n; b++) {
        now.push_back(geometryNow(scene, b, saved.bodies[b].geometry));
        if (!sameGeometry(now[b], saved.bodies[b].geometry)) others.push_back(b);
    }
    if (mirror.hasPositions()) {
        scene.arrays->pullPositions();
        checkPosesAgainstPositions(scene, saved);
    }
    if (scene.fluid) {
        scene.fluid->getMemory().checkOfScheme(saved.memory, scene.integrator.getScheme());
        scene.fluid->getMemory().checkLastStep(saved.lastStep);
        scene.fluid->getMemory().checkHolds(saved.holds);
    }
    scene.build(now);
    BodySet& bodies = scene.bodies;
    bodies.setInertiaScale(saved.inertiaScale);  // to which the saved angular momenta belong
    for (int b = 0; b < n; b++) {
        if (!scene.definitions.isExplicit(b)) scene.definitions.record(b, now[b]);
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
    scene.adoptInertia();
    if (scene.fluid) {
        scene.fluid->getMemory().setOfScheme(saved.memory, scene.integrator.getScheme());
        scene.fluid->getMemory().setLastStep(saved.lastStep);
        scene.fluid->getMemory().setHolds(saved.holds);
    }
    mirror.stateWasLoaded(saved, others);
    scene.noteChange();
}

}  // namespace

SavedState collectState(Scene& scene, ContextMirror& mirror) {
    SavedState saved;
    saved.seed = scene.settings.noise.seed;
    saved.stepNumber = scene.settings.noise.step;
    if (!mirror.hasPositions()) return saved;
    mirror.takeInChanges();
    saved.hasBodies = true;
    saved.inertiaScale = scene.bodies.getInertiaScale();
    saved.positionsHash = hashOf(scene.arrays->positions());
    saved.velocitiesHash = hashOf(scene.arrays->velocities());
    saved.seed = scene.noiseHistory.seedToSave(scene);
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        const BodyState state = scene.bodies.getState(b);
        SavedBody body;
        body.geometry = scene.definitions.geometries()[b];
        body.R = state.R;
        body.q = state.q;
        body.velocity = body.geometry.mass > 0 ? state.p / body.geometry.mass : Vec3();
        body.omega_lab = scene.bodies.getAngularVelocity_lab(b);
        body.stored = scene.bodies.getStoredState(b);
        saved.bodies.push_back(body);
    }
    if (scene.fluid) {
        saved.memory = scene.fluid->getMemory().getOfScheme();
        saved.holds = scene.fluid->getMemory().getHolds();
        if (scene.fluid->getFlowReader().lastStepIsPresent(scene.bodies, scene.arrays->positions()))
            saved.lastStep = scene.fluid->getMemory().getLastStep();
    }
    saved.rounding = scene.arrays->rounding();
    if (!saved.rounding.isExact())
        for (int p : scene.stock.otherParticles)
            saved.particles.push_back(
                {p, scene.arrays->positions()[p], scene.arrays->velocities()[p]});
    scene.noiseHistory.wasSaved(saved, scene);
    return saved;
}

void adoptState(const SavedState& saved, Scene& scene, ContextMirror& mirror) {
    if (saved.hasBodies) adoptBodies(saved, scene, mirror);
    scene.noiseHistory.willLoad(saved, scene);
    scene.settings.noise.seed = saved.seed;
    scene.settings.noise.step = saved.stepNumber;
}

void adoptState(const SerializationNode& node, Scene& scene, ContextMirror& mirror) {
    // A State that was saved under an integrator without parameters has no parameters. Its
    // positions and velocities are enough.
    if (node.getChildren().empty() && node.getProperties().empty()) return;
    for (const SerializationNode& child : node.getChildren())
        if (child.getName() == "RigidBodyState") {
            adoptState(SavedState::read(child), scene, mirror);
            return;
        }
    fail(
        "the State's integrator parameters belong to another integrator; save the State without "
        "these parameters (in Python: getState(getIntegratorParameters=False)), or load it under "
        "the integrator that saved it");
}

void checkPosesAgainstPositions(const Scene& scene, const SavedState& saved) {
    const vector<Vec3>& positions = scene.arrays->positions();
    if (hashOf(positions) != saved.positionsHash) return;
    for (size_t b = 0; b < saved.bodies.size(); b++) {
        const SavedBody& body = saved.bodies[b];
        const Eigen::Quaterniond q(body.q[0], body.q[1], body.q[2], body.q[3]);
        const vector<int>& particles = scene.definitions.particles(b);
        for (size_t i = 0; i < particles.size(); i++) {
            // Virtual sites follow the other particles, and may not have been placed yet.
            if (scene.system.isVirtualSite(particles[i])) continue;
            const Vec3 place = body.R + toVec3(q * toEigen(body.geometry.sites[i])),
                       off = positions[particles[i]] - place;
            const double distance = sqrt(off.dot(off)),
                         tolerance = scene.integrator.getPoseTolerance();
            if (!(distance <= tolerance))
                fail("body " + to_string(b) + ": the saved state is corrupt: particle " +
                     to_string(particles[i]) + " is " + text(distance) +
                     " nm from where the saved pose puts it, more than the pose tolerance " +
                     text(tolerance) + " nm; use another state");
        }
    }
}

}  // namespace RigidHIPlugin
