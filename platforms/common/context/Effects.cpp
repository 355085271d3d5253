#include "context/Effects.h"

#include <openmm/reference/SimTKOpenMMRealType.h>

#include <algorithm>
#include <cmath>

#include "context/Libraries.h"
#include "context/Messages.h"
#include "context/Mismatches.h"
#include "context/MomentumRemoval.h"
#include "context/Scene.h"
#include "fluid/FluidReport.h"
#include "fluid/StepResolution.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

bool isOfDevice(const string& platform) {
    return platform == "CUDA" || platform == "OpenCL" || platform == "HIP";
}

/** Why the host moves bodies where the platform's kernel has no steps of its own. */
string reasonWithoutSteps(const string& platform) {
    if (isOfDevice(platform))
        return "the library libOpenMMRigidHI" + platform +
               ".so is not loaded; call openmmrigidhi.checkPlatform('" + platform +
               "') before you create a Context, which loads this library or says why it cannot";
    return "platform " + platform + " has no steps of its own";
}

/** Has one member for each subject. Each member states whether its effects are on, and why. */
class EffectFinder {
public:
    EffectFinder(const Scene& scene, const string& platform)
        : scene(scene), platform(platform), scheme(traitsOf(scene.integrator.getScheme())),
          fluid(scene.fluid), temperature(scene.integrator.getTemperature()) {
        const CustomRigidHIIntegrator& integrator = scene.integrator;
        gamma = integrator.getFriction();
        for (int b = 0; scene.isBuilt() && b < scene.bodies.getNumBodies(); b++) {
            if (scene.bodies.isHeld(b)) continue;
            double ownGamma, ownRotational;
            integrator.getBodyFriction(b, ownGamma, ownRotational);
            gamma = max(gamma, ownGamma);
            Gamma = max(Gamma, ownRotational);
        }
    }
    map<string, string> find() {
        findScheme();
        findFluid();
        findHeld();
        findPrescribed();
        findJoints();
        findSlips();
        findDrift();
        findSlowedSpins();
        findInertia();
        findRotation();
        findSystem();
        findElongatedBodies();
        findAdvice();
        string all;
        if (scene.isBuilt())
            for (const auto& w : findAllWarnings(scene))
                all += (all.empty() ? "" : "; ") + w.second;
        set("warnings", !all.empty(), all.empty() ? "none" : all);
        return effects;
    }

private:
    void set(const string& name, bool on, const string& why) {
        effects[name] = (on ? "on: " : "off: ") + why;
    }

    /** The scheme, its noise and its friction. */
    void findScheme() {
        set("scheme", true, scheme.name);
        set("loops", true, platform + ": " + scene.loops->describe());
        const string reason =
            scene.native ? scene.native->reasonForHost() : reasonWithoutSteps(platform);
        set("bodies on the device", reason.empty(),
            reason.empty() ? scene.native->describe() : "the host moves bodies: " + reason);
        const auto products = scene.loops->describeProducts();
        set("products on the device", products.first, products.second);
        const bool momenta = scheme.hasMomenta, hydrodynamic = scheme.needsFluid();
        set("momenta", momenta, momenta ? "the scheme has momenta" : "the scheme has no momenta");
        const bool dissipates = !momenta || gamma > 0 || Gamma > 0 || hydrodynamic;
        set("noise", temperature > 0 && dissipates,
            temperature == 0 ? "the temperature is 0: the scheme draws no random numbers and takes "
                               "no square roots"
            : dissipates     ? "temperature " + number(temperature) + " K"
                             : string("all frictions are 0: the scheme draws no random numbers and "
                                          "conserves energy"));
        const string noRates =
            hydrodynamic ? "the fluid's friction takes its place" : "the scheme has no momenta";
        set("translational friction", hasRates() && gamma > 0,
            hasRates() ? "gamma up to " + number(gamma) + "/ps" : noRates);
        set("rotational friction", hasRates() && Gamma > 0,
            hasRates() ? "Gamma up to " + number(Gamma) + "/ps" : noRates);
    }

    /** The fluid, and which bodies feel each other through it. */
    void findFluid() {
        const bool hasForce = fluid.getParameters() != nullptr;
        const string missing =
            hasForce ? "positions are not set yet" : "the System has no MobilityForce";
        const bool withoutImages = hasForce && scene.system.usesPeriodicBoundaryConditions() &&
                                   !fluid.getParameters()->usesPeriodicBoundaryConditions();
        const BoundaryTraits* boundary =
            hasForce ? &traitsOf(fluid.getParameters()->getBoundary()) : nullptr;
        set("hydrodynamics", hasForce,
            (fluid ? FluidReport(fluid->getContents())
                         .describe(scheme, BOLTZ * temperature,
                                   scene.integrator.getFiniteDifferenceStep())
                   : missing) +
                (!withoutImages ? ""
                 : boundary->hasWalls()
                     ? string("; without images along ") + boundary->namesAlongWalls() +
                           ", though forces are periodic"
                     : "; unbounded, though forces are periodic"));
        set("mobilities asked for", hasForce,
            fluid ? FluidReport(fluid->getContents()).describeAnswers() : missing);
        const string flow = fluid ? FluidReport(fluid->getContents()).describeFlow() : "";
        set("driven flow", !flow.empty(),
            !fluid ? missing
            : flow.empty()
                ? string(
                      "neither setBackgroundFlow() nor setSinusoidalForceDensity() drives a flow, "
                      "and neither does a moving wall, a uniform force density or setShear()")
                : flow);
        const int interacting = fluid ? FluidReport(fluid->getContents()).numInteracting() : 0;
        set("hydrodynamic interactions", interacting > 0,
            !fluid            ? missing
            : interacting > 0 ? counted(interacting, "body or free particle interacts",
                                        "bodies and free particles interact") +
                                    " through the fluid"
            : !fluid->getContents().isUniform()
                ? string("no bodies or free particles interact through the "
                         "fluid, but each of them interacts with ") +
                      (fluid->getContents().isPeriodic() ? "its own images" : "the wall")
                : string("no bodies or free particles interact through the "
                         "fluid: every tensor is constant and computed once"));
    }

    /** Bodies and particles that never move. */
    void findHeld() {
        int bodies = 0;
        const int count = scene.definitions.getNumBodies(),
                  particles = scene.integrator.getHeldParticles().size();
        for (int b = 0; b < count; b++) bodies += scene.integrator.getBodyHeld(b);
        string held = counted(bodies, "body", "bodies");
        if (particles > 0) held += " and " + counted(particles, "particle", "particles");
        set("held bodies", bodies + particles > 0,
            bodies + particles == 0 ? "nothing is held"
            : scheme.needsFluid()   ? held + ": the fluid is at rest on them"
                                    : held + ": they have no momenta and no degrees of freedom");
    }

    void findJoints() {
        int numbers[4] = {0, 0, 0, 0};
        const auto& joints = scene.definitions.joints();
        for (const JointDefinition& joint : joints) numbers[joint.kind]++;
        string text;
        const char* const names[][2] = {{"ball", "balls"},
                                        {"ball to a point", "balls to points"},
                                        {"link", "links"},
                                        {"hinge", "hinges"}};
        for (int kind = 0; kind < 4; kind++)
            if (numbers[kind] > 0)
                text += (text.empty() ? "" : ", ") +
                        counted(numbers[kind], names[kind][0], names[kind][1]);
        const int motors = scene.definitions.motors().size();
        if (motors > 0) text += ", " + counted(motors, "motor", "motors");
        set("joints", !joints.empty(),
            joints.empty() ? "no bodies are joined"
                           : text +
                                 "; configurations have the measure of infinitely stiff springs; "
                                 "each step ends with a projection of the joints to " +
                                 number(scene.integrator.getJointTolerance()) + " nm");
    }

    void findPrescribed() {
        set("prescribed motion", scene.bodyMotions.isOn(), scene.bodyMotions.describe());
    }

    void findSlips() {
        const int count =
            fluid.getParameters() ? fluid.getParameters()->getBodiesWithSlip().size() : 0;
        set("active slip", count > 0,
            count == 0 ? string("no body has a slip")
                       : counted(count, "body", "bodies") + " whose surface moves the fluid");
        const int forces =
            fluid.getParameters() ? fluid.getParameters()->getNumBodyForcesOnFluid() : 0;
        set("forces on the fluid", forces > 0,
            forces == 0 ? string("no body exerts a force on the fluid at a site of its own")
                        : counted(forces,
                                  "force at a site that moves with its body, which takes "
                                  "the opposite force",
                                  "forces at sites that move with their bodies, which take the "
                                  "opposite forces"));
    }

    /** The drift of schemes without momenta, and how it is computed. */
    void findDrift() {
        if (scheme.isOverdamped() && fluid) {
            for (const auto& effect :
                 FluidReport(fluid->getContents())
                     .describeDrift(scheme, BOLTZ * temperature,
                                    scene.integrator.getFiniteDifferenceStep()))
                effects.insert(effect);
            return;
        }
        set("stochastic drift", false,
            scheme.isOverdamped() ? "positions are not set yet"
            : scheme.hasMomenta ? "the scheme has momenta, whose relaxation in a changing friction "
                                  "makes the drift without a term of its own"
                                : "the mobility does not depend on poses");
        set("finite differences", false,
            scheme.isOverdamped() ? "positions are not set yet" : "the scheme has none");
    }

    /** Rotations that a step without momenta does not resolve. */
    void findSlowedSpins() {
        const string name = "slowed spins";
        if (!scheme.isOverdamped() || !fluid) {
            set(name, false,
                scheme.isOverdamped() ? "positions are not set yet"
                                      : "the scheme turns bodies as they are");
            return;
        }
        const StepResolution step =
            resolveOverdamped(fluid->getContents(), scene.integrator.getScheme(),
                              scene.integrator.getStepSize(), BOLTZ * temperature);
        set(name, step.numSlowed > 0,
            temperature == 0 ? string("the temperature is 0")
            : step.numSlowed == 0
                ? string("the step resolves the rotation of each body about its "
                         "fastest axis, or no axis is much faster than another")
                : counted(step.numSlowed, "body", "bodies") + " would spin at random by up to " +
                      text(step.spin, 3) + " rad a step about the fastest axis (" + step.spinner +
                      "), which this step does not resolve: the scheme spins them by " +
                      text(step.slowedSpin, 3) +
                      " rad instead. Averages over configurations and the motion of the axis do "
                      "not change, but noise, forces and torques turn bodies about the axis more "
                      "slowly; steps below " +
                      text(step.longestStepOfSpins, 3) + " ps have the real spin");
    }

    void findInertia() {
        const double factor = scene.integrator.getInertiaScale();
        const bool on = factor != 1 && scheme.hasMomenta;
        set("inertia scale", on,
            on ? "the dynamics has the principal moments times " + number(factor) +
                     ": averages over configurations do not depend on this factor, but the motion "
                     "is not the real one"
            : factor == 1 ? string("the dynamics has the real principal moments")
                          : "the scheme has no momenta, so that the factor " + number(factor) +
                                " has no effect");
    }

    void findRotation() {
        if (scheme.isOverdamped()) {
            set("rotation", scene.definitions.getNumBodies() > 0,
                counted(scene.definitions.getNumBodies(), "body", "bodies") +
                    ", each rotated in the lab frame by its angular velocity times the "
                    "step" +
                    (fluid ? "; " +
                                 counted(FluidReport(fluid->getContents()).numCollinear(),
                                         "has its blobs on a line and does",
                                         "have their blobs on a line and do") +
                                 " not rotate about this line"
                           : string("; positions are not set yet")));
            return;
        }
        int general = 0, linear = 0, points = 0;
        for (int b = 0; scene.isBuilt() && b < scene.bodies.getNumBodies(); b++) {
            if (scene.bodies.isHeld(b)) continue;
            (scene.bodies.rotor(b) == RotorKind::General  ? general
             : scene.bodies.rotor(b) == RotorKind::Linear ? linear
                                                          : points)++;
        }
        set("rotation", general + linear > 0,
            counted(general, "body", "bodies") + " about three axes (symmetric splitting), " +
                counted(linear, "linear body", "linear bodies") + " (exact), " + to_string(points) +
                " without rotation" + (scene.isBuilt() ? "" : " (positions are not set yet)"));
    }

    /** The parts of the System apart from bodies. */
    void findSystem() {
        const int numFree = scene.freeParticles->getNumParticles(),
                  constraints = scene.freeParticles->getNumConstraints();
        set("free particles", numFree > 0,
            (scheme.isOverdamped()
                 ? counted(numFree, "particle that the fluid sees is",
                           "particles that the fluid sees are")
                 : counted(numFree, "massive particle is", "massive particles are")) +
                " in no body");
        set("constraints of free particles", constraints > 0,
            counted(constraints, "constraint", "constraints") +
                (scene.stock.numFreeWaters == 0
                     ? string()
                     : ", also of " +
                           counted(scene.stock.numFreeWaters, "rigid water that is",
                                   "rigid waters that are") +
                           " in no body (openmmrigidhi.app.addRigidWater() makes bodies)"));
        set("centre-of-mass motion removal", scene.stock.hasCMMotionRemover,
            !scene.stock.hasCMMotionRemover ? "the System has no CMMotionRemover"
            : massesAreTheSystems(scene)
                ? "the System has a CMMotionRemover"
                : "the System has a CMMotionRemover; the momentum to remove follows from the "
                  "bodies' own masses, which are not all those of the System");
        set("barostat", !scene.stock.barostat.empty(), describeBarostat(scene));
        const string later = bodiesWithoutContext(scene);
        set("bodies", scene.definitions.getNumBodies() > 0,
            counted(scene.definitions.getNumBodies(), "body", "bodies") +
                (later.empty() ? "" : "; " + later));
        const int groups = scene.integrator.getIntegrationForceGroups();
        set("body forces", scene.bodyForces.isOn(groups), scene.bodyForces.describe(groups));
    }

    /** Bodies whose rates of rotation are not those of their moments (Thermostat.h). */
    void findElongatedBodies() {
        int elongated = 0, first = -1;
        const bool thermostat = hasRates() || scheme.kind == SchemeKind::Thermostat;
        for (int b = 0; scene.isBuilt() && thermostat && b < scene.bodies.getNumBodies(); b++)
            if (!scene.bodies.isHeld(b) && scene.bodies.inertia(b).isElongated() &&
                elongated++ == 0)
                first = b;
        set("elongated bodies", elongated > 0,
            !thermostat      ? string("the fluid's friction damps rotation")
            : elongated == 0 ? string("no body has a moment below a tenth of its middle one")
                             : counted(elongated, "body has", "bodies have") +
                                   " a moment below a tenth of the middle one (the first is body " +
                                   to_string(first) +
                                   "): their frictions of rotation change continuously to those of "
                                   "a linear body, so that the thermostat reaches the tumbling");
    }

    /** What would make steps faster, if there is something. */
    void findAdvice() {
        string advice = fluid ? adviceOnLinearAlgebra() : "";
        const string& onDevice = effects.at("bodies on the device");
        if (isOfDevice(platform) && scene.isBuilt() && scene.definitions.getNumBodies() > 0 &&
            onDevice.compare(0, 4, "off:") == 0)
            advice += (advice.empty() ? "" : "; ") + onDevice.substr(5) +
                      ", so that each step transfers positions and forces";
        // Measured on the page of benchmarks, "Few bodies: take Reference".
        const int few = 30, bodies = scene.definitions.getNumBodies();
        if (platform != "Reference" && bodies > 0 && scene.system.getNumParticles() <= few)
            advice += (advice.empty() ? "" : "; ") + string("for so few particles platform ") +
                      platform +
                      " takes longer than Reference, by a tenth of a millisecond a step or more; "
                      "take Reference";
        if (!advice.empty()) set("advice", true, advice);
    }

    /** Whether friction is a rate that the integrator sets. */
    bool hasRates() const { return scheme.hasMomenta && !scheme.needsFluid(); }

    const Scene& scene;
    const string platform;
    const SchemeTraits& scheme;
    const ContextFluid& fluid;
    const double temperature;
    double gamma = 0, Gamma = 0;  // largest of all bodies
    map<string, string> effects;
};

}  // namespace

map<string, string> findEffects(const Scene& scene, const string& platform) {
    return EffectFinder(scene, platform).find();
}

map<string, int> countDegreesOfFreedom(const Scene& scene) {
    const BodySet& bodies = scene.bodies;
    map<string, int> dof = {{"translational", 0}, {"rotational1", 0}, {"rotational2", 0},
                            {"rotational3", 0},   {"free", 0},        {"removed", 0},
                            {"total", 0}};
    if (!traitsOf(scene.integrator.getScheme()).hasMomenta) return dof;
    dof["translational"] = 3 * bodies.getNumMovable();
    for (int b = 0; b < bodies.getNumBodies(); b++)
        for (int k = 0; k < 3; k++)
            dof["rotational" + to_string(k + 1)] +=
                !bodies.isHeld(b) && bodies.inertia(b).isLive(k);
    const FreeParticles& free = *scene.freeParticles;
    dof["free"] = 3 * (free.getNumParticles() - free.getNumHeld()) - free.getNumConstraints();
    const bool anythingMoves = dof["translational"] + dof["free"] > 0;
    dof["removed"] = scene.stock.hasCMMotionRemover && anythingMoves ? 3 : 0;
    dof["total"] = dof["translational"] + dof["rotational1"] + dof["rotational2"] +
                   dof["rotational3"] + dof["free"] - dof["removed"];
    return dof;
}

map<string, double> nameCounters(const Scene& scene) {
    const ContextFluid& fluid = scene.fluid;
    const GridSeconds grid = fluid ? fluid->getCosts().getGridSeconds() : GridSeconds();
    const NativeSteps::Counts native =
        scene.native ? scene.native->getCounts() : NativeSteps::Counts();
    return {{"steps", scene.counters.steps},
            {"deviceLaunches", native.launches},
            {"deviceTransfers", native.transfers + scene.arrays->getNumTransfers()},
            {"deviceLooks", native.looks},
            {"forceEvaluations", scene.counters.forceEvaluations},
            {"mobilityProducts", fluid ? fluid->getCosts().getNumProducts() : 0},
            {"solverIterations", scene.counters.iterations},
            {"randomNumbers", scene.counters.randomNumbers},
            {"squareRoots", scene.counters.squareRoots},
            {"seconds_forces", scene.counters.seconds_forces},
            {"seconds_mobility", scene.counters.seconds_mobility},
            {"seconds_scheme", scene.counters.seconds_scheme},
            {"seconds_spreading", grid.spreading},
            {"seconds_fft", grid.transforms},
            {"seconds_averaging", grid.averaging},
            {"seconds_solver", fluid ? fluid->getCosts().getSecondsOfSolver() : 0}};
}

}  // namespace RigidHIPlugin
