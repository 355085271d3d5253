#include "context/Effects.h"

#include <openmm/reference/SimTKOpenMMRealType.h>

#include <algorithm>

#include "context/Messages.h"
#include "context/MomentumRemoval.h"
#include "context/Scene.h"

using namespace std;

namespace RigidHIPlugin {

map<string, string> findEffects(const Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    const BodySet& bodies = scene.bodies;
    const ContextFluid& fluid = scene.fluid;
    const bool hasFluidForce = fluid.getParameters() != nullptr;
    const bool momenta = traitsOf(integrator.getScheme()).hasMomenta;
    const double T = integrator.getTemperature();
    double gamma = integrator.getFriction(), Gamma = 0, ownGamma, ownRotational;
    int general = 0, linear = 0, points = 0;
    if (scene.isBuilt())
        for (int b = 0; b < bodies.getNumBodies(); b++) {
            integrator.getBodyFriction(b, ownGamma, ownRotational);
            gamma = max(gamma, ownGamma);
            Gamma = max(Gamma, ownRotational);
            (bodies.rotor(b) == RotorKind::General  ? general
             : bodies.rotor(b) == RotorKind::Linear ? linear
                                                    : points)++;
        }
    map<string, string> effects;
    auto set = [&](const string& name, bool on, const string& why) { effects[name] = (on ? "on: " : "off: ") + why; };
    set("scheme", true, traitsOf(integrator.getScheme()).name);
    set("momenta", momenta, momenta ? "the scheme has them" : "a scheme without momenta");
    const bool hydrodynamic = traitsOf(integrator.getScheme()).needsFluid(),
               overdamped = traitsOf(integrator.getScheme()).isOverdamped();
    const bool dissipates = !momenta || gamma > 0 || Gamma > 0 || hydrodynamic;
    set("noise", T > 0 && dissipates,
        T == 0       ? "the temperature is 0: no random numbers are drawn, no square roots taken"
        : dissipates ? "temperature " + number(T) + " K"
                     : string("all frictions are 0: no random numbers are drawn and energy is conserved"));
    const bool rates = momenta && !hydrodynamic;
    const string noRates = hydrodynamic ? "the fluid's friction takes its place" : "a scheme without momenta";
    set("translational friction", rates && gamma > 0, rates ? "gamma up to " + number(gamma) + "/ps" : noRates);
    set("rotational friction", rates && Gamma > 0, rates ? "Gamma up to " + number(Gamma) + "/ps" : noRates);
    if (!hasFluidForce) set("hydrodynamics", false, "the System has no MobilityForce");
    if (hasFluidForce) set("hydrodynamics", true, fluid ? fluid->describe(overdamped) : "positions are not set yet");
    set("mobilities asked for", hasFluidForce,
        !hasFluidForce ? string("the System has no MobilityForce")
        : fluid        ? fluid->describeAnswers()
                       : string("positions are not set yet"));
    set("hydrodynamic interactions", fluid && fluid->numInteracting() > 0,
        !hasFluidForce ? string("the System has no MobilityForce")
        : !fluid       ? string("positions are not set yet")
        : fluid->numInteracting() > 0
            ? to_string(fluid->numInteracting()) + " bodies and free particles feel others through the fluid"
        : !fluid->isUniform()
            ? string("nothing feels others through the fluid, but everything feels the wall")
            : string("nothing feels others through the fluid: every tensor is constant and known once for all"));
    if (overdamped && fluid) {
        const double kT = BOLTZ * T;
        for (const auto& effect :
             fluid->describeDrift(traitsOf(integrator.getScheme()), kT, integrator.getFiniteDifferenceStep()))
            effects.insert(effect);
    } else {
        set("stochastic drift", false,
            overdamped ? "positions are not set yet"
            : momenta  ? "the scheme has momenta, which relax while the friction changes: what makes it is there "
                         "without a term of its own"
                       : "the mobility does not depend on poses");
        set("finite differences", false, overdamped ? "positions are not set yet" : "the scheme has none");
    }
    if (overdamped)
        set("rotation", scene.definitions.getNumBodies() > 0,
            to_string(scene.definitions.getNumBodies()) +
                " bodies, each turned in the lab by its angular velocity times the step" +
                (fluid ? "; " + to_string(fluid->numCollinear()) +
                             " of them have their blobs on a line and do not turn about it"
                       : string("; positions are not set yet")));
    else
        set("rotation", general + linear > 0,
            to_string(general) + " bodies about three axes (symmetric splitting), " + to_string(linear) +
                " linear bodies (exact), " + to_string(points) + " without rotation" +
                (scene.isBuilt() ? "" : " (positions are not set yet)"));
    set("free particles", scene.freeParticles->getNumParticles() > 0,
        to_string(scene.freeParticles->getNumParticles()) +
            (overdamped ? " particles that the fluid sees are in no body" : " massive particles are in no body"));
    set("constraints of free particles", scene.freeParticles->getNumConstraints() > 0,
        to_string(scene.freeParticles->getNumConstraints()) + " constraints");
    set("centre-of-mass motion removal", scene.stock.hasCMMotionRemover,
        !scene.stock.hasCMMotionRemover ? "the System has no CMMotionRemover"
        : massesAreTheSystems(scene)    ? "the System has a CMMotionRemover"
                                     : "the System has a CMMotionRemover; what is removed is the bodies' own momentum, "
                                       "since not all their masses "
                                       "are the System's");
    set("barostat", !scene.stock.barostat.empty(),
        scene.stock.barostat.empty() ? "the System has none" : "the System has a " + scene.stock.barostat);
    const int groups = integrator.getIntegrationForceGroups();
    set("body forces", scene.bodyForces.isOn(groups), scene.bodyForces.describe(groups));
    set("loops", true, scene.loops->describe());

    // In water the three axes differ by a factor 3; here an axis relaxes ten times slower than the mean of the live
    // ones.
    const double slow = 0.1;
    int slowBodies = 0, firstSlow = -1;
    for (int b = 0; scene.isBuilt() && rates && b < bodies.getNumBodies(); b++) {
        const BodyInertia& inertia = bodies.inertia(b);
        const int live = inertia.isLive(0) + inertia.isLive(1) + inertia.isLive(2);
        if (inertia.isLive(2) && inertia.rotationalRate(2, 1.0) < slow / live && slowBodies++ == 0) firstSlow = b;
    }
    set("weakly thermostatted axes", slowBodies > 0,
        slowBodies == 0 ? string("no body is that elongated")
                        : to_string(slowBodies) + " elongated bodies, the first of them body " + to_string(firstSlow) +
                              ": their thick axes relax at Gamma/(I sum 1/I), less than a tenth of the mean rate");
    string all;
    if (scene.isBuilt())
        for (const auto& w : findWarnings(scene)) all += (all.empty() ? "" : "; ") + w.second;
    set("warnings", !all.empty(), all.empty() ? "none" : all);
    return effects;
}

map<string, int> countDegreesOfFreedom(const Scene& scene) {
    const BodySet& bodies = scene.bodies;
    map<string, int> dof = {{"translational", 0}, {"rotational1", 0}, {"rotational2", 0}, {"rotational3", 0},
                            {"free", 0},          {"removed", 0},     {"total", 0}};
    if (!traitsOf(scene.integrator.getScheme()).hasMomenta) return dof;
    dof["translational"] = 3 * bodies.getNumBodies();
    for (int b = 0; b < bodies.getNumBodies(); b++)
        for (int k = 0; k < 3; k++) dof["rotational" + to_string(k + 1)] += bodies.inertia(b).isLive(k);
    dof["free"] = 3 * scene.freeParticles->getNumParticles() - scene.freeParticles->getNumConstraints();
    const bool anythingMoves = dof["translational"] + dof["free"] > 0;
    dof["removed"] = scene.stock.hasCMMotionRemover && anythingMoves ? 3 : 0;
    dof["total"] = dof["translational"] + dof["rotational1"] + dof["rotational2"] + dof["rotational3"] + dof["free"] -
                   dof["removed"];
    return dof;
}

map<string, double> nameCounters(const Scene& scene) {
    const ContextFluid& fluid = scene.fluid;
    return {{"steps", scene.counters.steps},
            {"forceEvaluations", scene.counters.forceEvaluations},
            {"mobilityProducts", fluid ? fluid->numProducts() + fluid->numMatrices() : 0},
            {"solverIterations", fluid ? fluid->numIterations : 0},
            {"randomNumbers", scene.counters.randomNumbers},
            {"squareRoots", fluid ? fluid->numSquareRoots : 0},
            {"seconds_forces", scene.counters.seconds_forces},
            {"seconds_mobility", scene.counters.seconds_mobility},
            {"seconds_scheme", scene.counters.seconds_scheme},
            {"seconds_fft", 0}};
}

}  // namespace RigidHIPlugin
