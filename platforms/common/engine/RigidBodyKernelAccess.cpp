// RigidBodyKernel: what users ask for and set.

#include <openmm/OpenMMException.h>
#include <openmm/reference/SimTKOpenMMRealType.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "engine/RigidBodyKernel.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

[[noreturn]] void fail(const string& message) { throw OpenMMException("CustomRigidHIIntegrator: " + message); }

string number(double x) {
    ostringstream text;
    text << x;
    return text.str();
}

}  // namespace

vector<Vec3> RigidBodyKernel::getBodyPositions(ContextImpl& context) {
    requirePositions("getBodyPositions()");
    takeInChanges(context);
    vector<Vec3> result;
    for (int b = 0; b < bodies.getNumBodies(); b++) result.push_back(bodies.getState(b).R);
    return result;
}

vector<QuaternionArray> RigidBodyKernel::getBodyOrientations(ContextImpl& context) {
    requirePositions("getBodyOrientations()");
    takeInChanges(context);
    vector<QuaternionArray> result;
    for (int b = 0; b < bodies.getNumBodies(); b++) result.push_back(bodies.getState(b).q);
    return result;
}

vector<Vec3> RigidBodyKernel::getBodyVelocities(ContextImpl& context) {
    requirePositions("getBodyVelocities()");
    takeInChanges(context);
    vector<Vec3> result;
    for (int b = 0; b < bodies.getNumBodies(); b++)
        result.push_back(bodies.getState(b).p / max(bodies.inertia(b).mass, 1e-300));
    return result;
}

vector<Vec3> RigidBodyKernel::getBodyAngularVelocities(ContextImpl& context) {
    requirePositions("getBodyAngularVelocities()");
    takeInChanges(context);
    vector<Vec3> result;
    for (int b = 0; b < bodies.getNumBodies(); b++) result.push_back(bodies.getAngularVelocity_lab(b));
    return result;
}

void RigidBodyKernel::setBodyPositions(ContextImpl& context, const vector<Vec3>& rows) {
    requirePositions("setBodyPositions()");
    takeInChanges(context);
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        BodyState state = bodies.getState(b);
        state.R = rows[b];
        bodies.setState(b, state);
    }
    if (fluid) fluid->forgetMemory();
    writePoses(context);
    forcesAreValid = false;
}

void RigidBodyKernel::setBodyOrientations(ContextImpl& context, const vector<QuaternionArray>& rows) {
    requirePositions("setBodyOrientations()");
    takeInChanges(context);
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const Vec3 omega_lab = bodies.getAngularVelocity_lab(b);  // the motion in the lab stays
        BodyState state = bodies.getState(b);
        const auto& q = rows[b];
        const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        const bool same = state.q == q;
        for (int k = 0; k < 4; k++) state.q[k] = q[k] / length;
        if (same) continue;
        bodies.setState(b, state);
        bodies.setAngularVelocity_lab(b, omega_lab);
    }
    if (fluid) fluid->forgetMemory();
    writePoses(context);
    forcesAreValid = false;
}

void RigidBodyKernel::setBodyVelocities(ContextImpl& context, const vector<Vec3>& rows) {
    requirePositions("setBodyVelocities()");
    takeInChanges(context);
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        BodyState state = bodies.getState(b);
        state.p = rows[b] * bodies.inertia(b).mass;
        bodies.setState(b, state);
    }
    runLoop(BodyLoop::ScatterVelocities);
}

void RigidBodyKernel::setBodyAngularVelocities(ContextImpl& context, const vector<Vec3>& rows) {
    requirePositions("setBodyAngularVelocities()");
    takeInChanges(context);
    for (int b = 0; b < bodies.getNumBodies(); b++) bodies.setAngularVelocity_lab(b, rows[b]);
    runLoop(BodyLoop::ScatterVelocities);
}

vector<Vec3> RigidBodyKernel::getBodyForces(ContextImpl& context) {
    requireGeometry(context);
    vector<Vec3> result;
    for (int b = 0; b < bodies.getNumBodies(); b++) result.push_back(bodies.getForce_lab(b));
    return result;
}

vector<Vec3> RigidBodyKernel::getBodyTorques(ContextImpl& context) {
    requireGeometry(context);
    vector<Vec3> result;
    for (int b = 0; b < bodies.getNumBodies(); b++) result.push_back(bodies.getTorque_lab(b));
    return result;
}

double RigidBodyKernel::getPoseResidual(ContextImpl& context) {
    requirePositions("getPoseResidual()");
    takeInChanges(context);
    return poseResidual;
}

double RigidBodyKernel::computeTranslationalKineticEnergy(ContextImpl& context) {
    if (!traitsOf(integrator->getScheme()).hasMomenta || !positionsAreSet) return 0;
    takeInVelocitiesIfChanged(context);
    return bodies.translationalKineticEnergy();
}

Vec3 RigidBodyKernel::computeRotationalKineticEnergies(ContextImpl& context) {
    if (!traitsOf(integrator->getScheme()).hasMomenta || !positionsAreSet) return Vec3();
    takeInVelocitiesIfChanged(context);
    return bodies.rotationalKineticEnergies();
}

double RigidBodyKernel::computeFreeParticleKineticEnergy(ContextImpl& context) {
    if (!traitsOf(integrator->getScheme()).hasMomenta) return 0;
    return freeParticles->kineticEnergy(velocities());
}

map<string, int> RigidBodyKernel::getDegreesOfFreedom(ContextImpl& context) {
    map<string, int> dof = {{"translational", 0}, {"rotational1", 0}, {"rotational2", 0}, {"rotational3", 0},
                            {"free", 0},          {"removed", 0},     {"total", 0}};
    if (!traitsOf(integrator->getScheme()).hasMomenta) return dof;
    requireGeometry(context);
    dof["translational"] = 3 * bodies.getNumBodies();
    for (int b = 0; b < bodies.getNumBodies(); b++)
        for (int k = 0; k < 3; k++) dof["rotational" + to_string(k + 1)] += bodies.inertia(b).isLive(k);
    dof["free"] = 3 * freeParticles->getNumParticles() - freeParticles->getNumConstraints();
    const bool anythingMoves = dof["translational"] + dof["free"] > 0;
    dof["removed"] = stock.hasCMMotionRemover && anythingMoves ? 3 : 0;
    dof["total"] = dof["translational"] + dof["rotational1"] + dof["rotational2"] + dof["rotational3"] + dof["free"] -
                   dof["removed"];
    return dof;
}

map<string, string> RigidBodyKernel::getEffects(ContextImpl& context) {
    if (!bodiesAreBuilt && positionsAreSet) takeInChanges(context);
    const bool momenta = traitsOf(integrator->getScheme()).hasMomenta;
    const double T = integrator->getTemperature();
    double gamma = integrator->getFriction(), Gamma = 0, ownGamma, ownRotational;
    int general = 0, linear = 0, points = 0;
    if (bodiesAreBuilt)
        for (int b = 0; b < bodies.getNumBodies(); b++) {
            integrator->getBodyFriction(b, ownGamma, ownRotational);
            gamma = max(gamma, ownGamma);
            Gamma = max(Gamma, ownRotational);
            (bodies.rotor(b) == RotorKind::General  ? general
             : bodies.rotor(b) == RotorKind::Linear ? linear
                                                    : points)++;
        }
    map<string, string> effects;
    auto set = [&](const string& name, bool on, const string& why) { effects[name] = (on ? "on: " : "off: ") + why; };
    set("scheme", true, traitsOf(integrator->getScheme()).name);
    set("momenta", momenta, momenta ? "the scheme has them" : "a scheme without momenta");
    const bool hydrodynamic = traitsOf(integrator->getScheme()).needsFluid(),
               overdamped = traitsOf(integrator->getScheme()).isOverdamped();
    const bool dissipates = !momenta || gamma > 0 || Gamma > 0 || hydrodynamic;
    set("noise", T > 0 && dissipates,
        T == 0       ? "the temperature is 0: no random numbers are drawn, no square roots taken"
        : dissipates ? "temperature " + number(T) + " K"
                     : string("all frictions are 0: no random numbers are drawn and energy is conserved"));
    const bool rates = momenta && !hydrodynamic;
    const string noRates = hydrodynamic ? "the fluid's friction takes its place" : "a scheme without momenta";
    set("translational friction", rates && gamma > 0, rates ? "gamma up to " + number(gamma) + "/ps" : noRates);
    set("rotational friction", rates && Gamma > 0, rates ? "Gamma up to " + number(Gamma) + "/ps" : noRates);
    if (!fluidParameters) set("hydrodynamics", false, "the System has no MobilityForce");
    if (fluidParameters) set("hydrodynamics", true, fluid ? fluid->describe(overdamped) : "positions are not set yet");
    set("mobilities asked for", fluidParameters != nullptr,
        !fluidParameters ? string("the System has no MobilityForce")
        : fluid          ? fluid->describeAnswers()
                         : string("positions are not set yet"));
    set("hydrodynamic interactions", fluid && fluid->numInteracting() > 0,
        !fluidParameters ? string("the System has no MobilityForce")
        : !fluid         ? string("positions are not set yet")
        : fluid->numInteracting() > 0
            ? to_string(fluid->numInteracting()) + " bodies and free particles feel others through the fluid"
        : !fluid->isUniform()
            ? string("nothing feels others through the fluid, but everything feels the wall")
            : string("nothing feels others through the fluid: every tensor is constant and known once for all"));
    if (overdamped && fluid) {
        const double kT = BOLTZ * T;
        for (const auto& effect :
             fluid->describeDrift(traitsOf(integrator->getScheme()), kT, integrator->getFiniteDifferenceStep()))
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
        set("rotation", definitions->getNumRigidBodies() > 0,
            to_string(definitions->getNumRigidBodies()) +
                " bodies, each turned in the lab by its angular velocity times the step" +
                (fluid ? "; " + to_string(fluid->numCollinear()) +
                             " of them have their blobs on a line and do not turn about it"
                       : string("; positions are not set yet")));
    else
        set("rotation", general + linear > 0,
            to_string(general) + " bodies about three axes (symmetric splitting), " + to_string(linear) +
                " linear bodies (exact), " + to_string(points) + " without rotation" +
                (bodiesAreBuilt ? "" : " (positions are not set yet)"));
    set("free particles", freeParticles->getNumParticles() > 0,
        to_string(freeParticles->getNumParticles()) +
            (overdamped ? " particles that the fluid sees are in no body" : " massive particles are in no body"));
    set("constraints of free particles", freeParticles->getNumConstraints() > 0,
        to_string(freeParticles->getNumConstraints()) + " constraints");
    set("centre-of-mass motion removal", stock.hasCMMotionRemover,
        !stock.hasCMMotionRemover ? "the System has no CMMotionRemover"
        : massesAreTheSystems()   ? "the System has a CMMotionRemover"
                                  : "the System has a CMMotionRemover; what is removed is the bodies' own momentum, "
                                    "since not all their masses "
                                    "are the System's");
    set("barostat", !stock.barostat.empty(),
        stock.barostat.empty() ? "the System has none" : "the System has a " + stock.barostat);
    const int groups = integrator->getIntegrationForceGroups();
    set("body forces", bodyForces.isOn(groups), bodyForces.describe(groups));
    set("loops", true, loops->describe());

    // In water the three axes differ by a factor 3; here an axis relaxes ten times slower than the mean of the live
    // ones.
    const double slow = 0.1;
    int slowBodies = 0, firstSlow = -1;
    for (int b = 0; bodiesAreBuilt && rates && b < bodies.getNumBodies(); b++) {
        const BodyInertia& inertia = bodies.inertia(b);
        const int live = inertia.isLive(0) + inertia.isLive(1) + inertia.isLive(2);
        if (inertia.isLive(2) && inertia.rotationalRate(2, 1.0) < slow / live && slowBodies++ == 0) firstSlow = b;
    }
    set("weakly thermostatted axes", slowBodies > 0,
        slowBodies == 0 ? string("no body is that elongated")
                        : to_string(slowBodies) + " elongated bodies, the first of them body " + to_string(firstSlow) +
                              ": their thick axes relax at Gamma/(I sum 1/I), less than a tenth of the mean rate");
    string all;
    if (bodiesAreBuilt)
        for (const auto& w : warnings()) all += (all.empty() ? "" : "; ") + w.second;
    set("warnings", !all.empty(), all.empty() ? "none" : all);
    return effects;
}

string RigidBodyKernel::describeEffects(ContextImpl& context) {
    ostringstream text;
    for (const auto& effect : getEffects(context)) text << effect.first << " is " << effect.second << "\n";
    return text.str();
}

map<string, double> RigidBodyKernel::getStepStatistics(ContextImpl& context) {
    return {{"steps", counters.steps},
            {"forceEvaluations", counters.forceEvaluations},
            {"mobilityProducts", fluid ? fluid->numProducts() + fluid->numMatrices() : 0},
            {"solverIterations", fluid ? fluid->numIterations : 0},
            {"randomNumbers", counters.randomNumbers},
            {"squareRoots", fluid ? fluid->numSquareRoots : 0},
            {"seconds_forces", counters.seconds_forces},
            {"seconds_mobility", counters.seconds_mobility},
            {"seconds_scheme", counters.seconds_scheme},
            {"seconds_fft", 0}};
}

// ---------------------------------------------------------------------------------------------------------------------
// What a MobilityForce asks for

Fluid& RigidBodyKernel::requireFluid(ContextImpl& context, const char* method) {
    requirePositions(method);
    takeInChanges(context);
    if (!fluid) fail(string(method) + " needs a MobilityForce in the System");
    adoptWallRejection();
    return *fluid;
}

void RigidBodyKernel::updateFluid(ContextImpl& context, const MobilityForce& force) {
    if (!fluidParameters) fail("updateParametersInContext() needs a MobilityForce in the System");
    const string remedy = "; call reinitialize(preserveState=True) on the Context";
    if (force.getModel() != fluidParameters->getModel() || force.getBoundary() != fluidParameters->getBoundary())
        fail("the model or boundary of a MobilityForce cannot be changed by updateParametersInContext()" + remedy);
    if (force.getWallHeight() != fluidParameters->getWallHeight() ||
        force.getSphereWallMobility() != fluidParameters->getSphereWallMobility())
        fail(
            "the wall height or sphere-wall mobility of a MobilityForce cannot be changed by "
            "updateParametersInContext()" +
            remedy);
    if (force.getGroups() != fluidParameters->getGroups())
        fail("the groups of a MobilityForce cannot be changed by updateParametersInContext()" + remedy);
    if (force.getNumParticles() != fluidParameters->getNumParticles())
        fail("the number of particles of a MobilityForce cannot be changed by updateParametersInContext()" + remedy);
    for (int p = 0; p < force.getNumParticles(); p++)
        if ((force.getParticleRadius(p) > 0) != (fluidParameters->getParticleRadius(p) > 0))
            fail("particle " + to_string(p) +
                 ": its hydrodynamic radius cannot change between 0 and a positive value by "
                 "updateParametersInContext()" +
                 remedy);
    if (!bodiesAreBuilt) {
        checkFluid(force);
        *fluidParameters = force;
        return;
    }
    const unique_ptr<MobilityForce> before(new MobilityForce(*fluidParameters));
    *fluidParameters = force;
    try {
        rebuildFluid();
    } catch (...) {
        *fluidParameters = *before;
        throw;
    }
}

/** The fluid from changed parameters, or an exception and the fluid as it was. */
void RigidBodyKernel::rebuildFluid() {
    unique_ptr<Fluid> before(move(fluid));
    try {
        fluid = makeFluid(geometries, bodies);
        if (traitsOf(integrator->getScheme()).kind == SchemeKind::FluidThermostat) fluid->checkInertia(bodies);
    } catch (...) {
        fluid = move(before);
        throw;
    }
    fluid->continueFrom(*before);
    settingsVersion = -1;
}

/** The wall rejection is the integrator's and may change between steps, but operators are made for one. */
void RigidBodyKernel::adoptWallRejection() {
    if (!fluid || fluid->getForce().getBoundary() != MobilityForce::NoSlipWall ||
        fluid->getWallRejection() == integrator->getWallRejection())
        return;
    rebuildFluid();
}

namespace {

vector<double> rowAfterRow(const Eigen::MatrixXd& matrix) {
    vector<double> result(matrix.size());
    for (int i = 0; i < matrix.rows(); i++)
        for (int k = 0; k < matrix.cols(); k++) result[i * matrix.cols() + k] = matrix(i, k);
    return result;
}

}  // namespace

vector<double> RigidBodyKernel::getMobility(ContextImpl& context) {
    return rowAfterRow(requireFluid(context, "getMobilityInContext()").mobility(bodies, positions()));
}

vector<double> RigidBodyKernel::getFriction(ContextImpl& context) {
    return rowAfterRow(requireFluid(context, "getFrictionInContext()").friction(bodies, positions()));
}

vector<double> RigidBodyKernel::applyMobility(ContextImpl& context, const vector<double>& wrenches) {
    Fluid& there = requireFluid(context, "applyMobilityInContext()");
    if ((int)wrenches.size() != 6 * bodies.getNumBodies())
        fail("applyMobilityInContext() was given " + to_string(wrenches.size()) + " numbers, but there are " +
             to_string(bodies.getNumBodies()) + " bodies; give 6 numbers for each");
    const Eigen::VectorXd twists =
        there.apply(Eigen::Map<const Eigen::VectorXd>(wrenches.data(), wrenches.size()), bodies, positions());
    return vector<double>(twists.data(), twists.data() + twists.size());
}

vector<double> RigidBodyKernel::applyBlobMobility(ContextImpl& context, const vector<double>& forces) {
    Fluid& there = requireFluid(context, "applyBlobMobilityInContext()");
    const int particles = context.getSystem().getNumParticles();
    if ((int)forces.size() != 3 * particles)
        fail("applyBlobMobilityInContext() was given " + to_string(forces.size()) + " numbers, but the System has " +
             to_string(particles) + " particles; give 3 numbers for each of them, whether the fluid sees it or not");
    const Eigen::VectorXd velocities =
        there.applyToBlobs(Eigen::Map<const Eigen::VectorXd>(forces.data(), forces.size()), bodies, positions());
    return vector<double>(velocities.data(), velocities.data() + velocities.size());
}

int RigidBodyKernel::getNumRejectedSteps(ContextImpl&) {
    // The public type is int, the counter is not: a long run stays at the largest number instead of becoming negative.
    return static_cast<int>(min<long long>(counters.rejectedSteps, numeric_limits<int>::max()));
}

vector<Vec3> RigidBodyKernel::drawVelocities(ContextImpl& context, double temperature, int drawSeed) {
    requirePositions("setVelocitiesToTemperature()");
    if (!(temperature >= 0) || !isfinite(temperature))
        fail("setVelocitiesToTemperature(): the temperature is " + number(temperature) +
             " K; it must be 0 or positive and finite");
    takeInChanges(context);
    drawnVelocities = velocities();
    drawnTwists.clear();
    NoiseStream noise;
    noise.seed = drawSeed;
    const double kT = BOLTZ * temperature;
    const bool momenta = traitsOf(integrator->getScheme()).hasMomenta;
    if (!momenta) return drawnVelocities;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        double z[6];
        for (int k = 0; k < 3; k++) noise.pair(NoiseStream::Velocities, b, k, z[2 * k], z[2 * k + 1]);
        const BodyState old = bodies.getState(b);
        const BodyInertia& inertia = bodies.inertia(b);
        array<double, 13> stored = bodies.getStoredState(b);
        for (int k = 0; k < 3; k++) {
            stored[7 + k] = sqrt(inertia.mass * kT) * z[k];
            stored[10 + k] = sqrt(inertia.moments[k] * kT) * z[3 + k];
        }
        const array<double, 13> before = bodies.getStoredState(b);
        bodies.setStoredState(b, stored);
        drawnTwists.push_back(bodies.getState(b));
        const Vec3 velocity = drawnTwists[b].p / inertia.mass, omega_lab = bodies.getAngularVelocity_lab(b);
        const vector<int>& particles = definitions->getRigidBodyParticles(b);
        for (size_t i = 0; i < particles.size(); i++)
            drawnVelocities[particles[i]] = velocity + omega_lab.cross(positions()[particles[i]] - old.R);
        bodies.setStoredState(b, before);
    }
    for (int i = 0; i < freeParticles->getNumParticles(); i++) {
        double z[4];
        const int p = freeParticles->getParticles()[i];
        noise.pair(NoiseStream::Velocities, p, 8, z[0], z[1]);
        noise.pair(NoiseStream::Velocities, p, 9, z[2], z[3]);
        drawnVelocities[p] = Vec3(z[0], z[1], z[2]) * sqrt(kT / freeParticles->mass(i));
    }
    return drawnVelocities;
}

}  // namespace RigidHIPlugin
