#include "engine/RigidBodyKernel.h"

#include <openmm/OpenMMException.h>
#include <openmm/reference/SimTKOpenMMRealType.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <iostream>
#include <limits>
#include <random>
#include <sstream>

#include "engine/StateHash.h"
#include "schemes/Thermostats-inl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

[[noreturn]] void fail(const string& message) { throw OpenMMException("CustomRigidHIIntegrator: " + message); }

bool isFinite(const Vec3& v) { return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]); }

bool sameBits(const vector<Vec3>& a, const vector<Vec3>& b) {
    return a.size() == b.size() && memcmp(a.data(), b.data(), a.size() * sizeof(Vec3)) == 0;
}

Thermostat schemeCoefficients(CustomRigidHIIntegrator::Scheme scheme, const BodyInertia& body, const HeatBath& bath,
                              double h) {
    return scalar::withThermostat(scheme, [&](auto named) { return named.coefficients(body, bath, h); });
}

string number(double x) {
    ostringstream text;
    text << x;
    return text.str();
}

/** An integrator that is bound to nothing, with the scheme and the bodies of another. */
unique_ptr<CustomRigidHIIntegrator> copyDefinitions(const CustomRigidHIIntegrator& from) {
    unique_ptr<CustomRigidHIIntegrator> to(new CustomRigidHIIntegrator(from.getTemperature(), from.getStepSize()));
    to->setScheme(from.getScheme());
    for (int b = 0; b < from.getNumRigidBodies(); b++) {
        vector<int> particles = from.getRigidBodyParticles(b);
        double mass = 0;
        Vec3 moments;
        vector<Vec3> sites;
        const bool known = from.getRigidBodyGeometryIsKnown(b);
        if (known) from.getRigidBodyParameters(b, particles, mass, moments, sites);
        if (from.getRigidBodyIsExplicit(b)) {
            to->addRigidBody(particles, mass, moments, sites);
            continue;
        }
        to->addRigidBody(particles);
        if (known) to->recordBodyGeometry(b, mass, moments, sites);
    }
    return to;
}

// Where the schemes of Davidchack 2015 stop resolving a body's fast rotation (measured; docs/CONVENTIONS.md).
const double resolutionLimit = 0.1;
// Davidchack 2015, section VI: Langevin A breaks down above about these, 1/ps.
const double langevinAGammaLimit = 100, langevinARotationalLimit = 200;

}  // namespace

RigidBodyKernel::RigidBodyKernel(const string& name, const Platform& platform, ReferencePlatform::PlatformData& data)
    : IntegrateRigidBodiesKernel(name, platform), data(data) {}

void RigidBodyKernel::initialize(ContextImpl& context, const CustomRigidHIIntegrator& integratorToUse) {
    integrator = &integratorToUse;
    system = &context.getSystem();
    definitions = copyDefinitions(*integrator);
    stock = takeStock(context, *definitions);
    bodyForces = BodyForces(context);
    stock.velocityDependentForce = bodyForces.velocityDependence();
    checkScheme(*system, *definitions, stock);
    if (stock.mobilityForce) {
        // A copy: what the user sets later waits for updateParametersInContext().
        fluidParameters.reset(new MobilityForce(*stock.mobilityForce));
        stock.mobilityForce = fluidParameters.get();
    }
    loops = createLoops(context);
    freeParticles.reset(new FreeParticles(*system, stock.freeParticles, *data.constraints));

    lastPositions.assign(system->getNumParticles(), unsetVec3);
    lastVelocities = lastPositions;

    geometries.resize(definitions->getNumRigidBodies());
    bool allKnown = true;
    constraints.reset(new ConstraintsOfParticles(*system));
    for (int b = 0; b < definitions->getNumRigidBodies(); b++) {
        const bool known = definitions->getRigidBodyGeometryIsKnown(b);
        vector<int> particles = definitions->getRigidBodyParticles(b);
        BodyGeometry& g = geometries[b];
        if (known) definitions->getRigidBodyParameters(b, particles, g.mass, g.moments, g.sites);
        if (!definitions->getRigidBodyIsExplicit(b)) {
            // The System wins: a known shape is kept only as far as the System leaves it open, and with the System's masses.
            const BodyGeometryBuilder builder(*system, *constraints, definitions->getRigidBodyParticles(b),
                                              "body " + to_string(b));
            if (known || !builder.needsPositions()) {
                g = builder.update(g);
                recordGeometry(b, g);
            }
        }
        allKnown = allKnown && definitions->getRigidBodyGeometryIsKnown(b);
    }
    if (allKnown)
        buildBodies(geometries);
    else if (fluidParameters)
        checkFluid(*fluidParameters);

    seed = integrator->getRandomNumberSeed();
    while (seed == 0) seed = random_device()();
}

/** A shape has become known: tell the integrator too, unless it has been given another definition of the body
 * meanwhile. */
void RigidBodyKernel::recordGeometry(int b, const BodyGeometry& g) {
    definitions->recordBodyGeometry(b, g.mass, g.moments, g.sites);
    if (!integrator->getRigidBodyIsExplicit(b) &&
        integrator->getRigidBodyParticles(b) == definitions->getRigidBodyParticles(b))
        integrator->recordBodyGeometry(b, g.mass, g.moments, g.sites);
}

/**
 * Make everything that stands on the geometries of the bodies, or throw and leave it as it was. States stay at the origin until positions
 * are taken in.
 */
void RigidBodyKernel::buildBodies(const vector<BodyGeometry>& newGeometries) {
    const int n = definitions->getNumRigidBodies();
    vector<vector<int> > particles(n);
    vector<vector<double> > siteMasses(n);
    vector<vector<bool> > carriesForce(n);
    vector<PoseFit> newFits;
    for (int b = 0; b < n; b++) {
        const BodyGeometry& g = newGeometries[b];
        particles[b] = definitions->getRigidBodyParticles(b);
        vector<double> masses;
        vector<bool> isVirtual;
        map<int, Vec3> siteOfParticle;
        for (size_t i = 0; i < particles[b].size(); i++) {
            const int p = particles[b][i];
            masses.push_back(system->getParticleMass(p));
            isVirtual.push_back(system->isVirtualSite(p));
            carriesForce[b].push_back(!isVirtual.back());
            siteOfParticle[p] = g.sites[i];
        }
        for (size_t i = 0; i < particles[b].size(); i++) {
            if (!isVirtual[i]) continue;
            const Vec3 off = g.sites[i] - virtualSitePosition(*system, particles[b][i],
                                                              [&](int parent) { return siteOfParticle.at(parent); });
            const double distance = sqrt(off.dot(off));
            if (!(distance <= integrator->getPoseTolerance()))
                fail("body " + to_string(b) + ": the site given for particle " + to_string(particles[b][i]) + " is " +
                     number(distance) +
                     " nm from where the System's virtual site puts it, more than the pose tolerance " +
                     number(integrator->getPoseTolerance()) + " nm; mend the site position or the virtual site");
        }
        newFits.emplace_back(g, masses, isVirtual);
        if (newFits.back().massesMakeTheBody(g, masses)) siteMasses[b] = masses;
    }
    BodySet newBodies(newGeometries, particles, siteMasses, carriesForce);
    unique_ptr<Fluid> newFluid = makeFluid(newGeometries, newBodies);
    if (fluid) newFluid->continueFrom(*fluid);
    vector<BodyGeometry> present = newGeometries;
    const auto exchange = [&] {
        swap(geometries, present);
        swap(fits, newFits);
        swap(bodies, newBodies);
        swap(fluid, newFluid);
        settingsVersion = -1;
    };
    const bool wereBuilt = bodiesAreBuilt;
    exchange();
    bodiesAreBuilt = true;
    try {
        updateSettings();
    } catch (...) {
        exchange();
        bodiesAreBuilt = wereBuilt;
        throw;
    }
}

vector<vector<int> > RigidBodyKernel::particlesOfBodies() const {
    vector<vector<int> > particles;
    for (int b = 0; b < definitions->getNumRigidBodies(); b++)
        particles.push_back(definitions->getRigidBodyParticles(b));
    return particles;
}

/** What can be said of a fluid before the shapes of all bodies are known. */
void RigidBodyKernel::checkFluid(const MobilityForce& force) const {
    checkBoundary(force, *integrator);
    Fluid::check(force, integrator->getWallRejection(), *system, particlesOfBodies(), *freeParticles, *loops);
}

unique_ptr<Fluid> RigidBodyKernel::makeFluid(const vector<BodyGeometry>& ofBodies, const BodySet& arrays) {
    if (!fluidParameters) return nullptr;
    // The wall rejection is the integrator's, and may have been set since the Context was created.
    checkBoundary(*fluidParameters, *integrator);
    return unique_ptr<Fluid>(new Fluid(*fluidParameters, integrator->getWallRejection(), *system, particlesOfBodies(),
                                       ofBodies, arrays, *freeParticles, *loops));
}

/** Geometries that come from positions. They are known when everything that stands on them does. */
void RigidBodyKernel::deriveGeometries() {
    vector<BodyGeometry> derived = geometries;
    vector<int> found;
    for (int b = 0; b < definitions->getNumRigidBodies(); b++) {
        if (definitions->getRigidBodyGeometryIsKnown(b)) continue;
        const vector<int>& particles = definitions->getRigidBodyParticles(b);
        vector<Vec3> members;
        for (int p : particles) members.push_back(positions()[p]);
        derived[b] = BodyGeometryBuilder(*system, *constraints, particles, "body " + to_string(b)).build(members);
        found.push_back(b);
    }
    buildBodies(derived);
    for (int b : found) recordGeometry(b, derived[b]);
}

void RigidBodyKernel::resetBodyGeometry(ContextImpl& context) {
    definitions->resetBodyGeometry();
    bodiesAreBuilt = forcesAreValid = compareByHash = false;
    loaded.reset();
    // What was taken in belongs to the old geometry.
    lastPositions.assign(lastPositions.size(), unsetVec3);
    lastVelocities = lastPositions;
    userChangedState = true;
}

void RigidBodyKernel::requirePositions(const char* what) const {
    if (!positionsAreSet) fail(string(what) + " needs positions: call setPositions() on the Context first");
}

void RigidBodyKernel::requireGeometry(ContextImpl& context) {
    if (bodiesAreBuilt) return;
    requirePositions("the geometry of bodies that were added without one");
    takeInChanges(context);
}

/** Recompute what depends on settings, if any was changed. */
void RigidBodyKernel::updateSettings() {
    const double h = integrator->getStepSize();
    if (settingsVersion == integrator->getSettingsVersion() && settingsStepSize == h) return;
    definitions->setScheme(integrator->getScheme());
    checkScheme(*system, *definitions, stock);
    adoptWallRejection();
    settings.scheme = integrator->getScheme();
    settings.h = h;
    settings.noise.law = static_cast<NoiseStream::Law>(integrator->getNoiseLaw());
    HeatBath bath;
    bath.kT = BOLTZ * integrator->getTemperature();
    bath.upsilon = integrator->getGradientRelaxationTime();
    bath.Upsilon = integrator->getGradientRotationalRelaxationTime();
    const bool hydrodynamic = settings.traits().kind == SchemeKind::FluidThermostat;
    if (hydrodynamic) fluid->checkInertia(bodies);
    settings.kT = bath.kT;
    settings.difference = integrator->getFiniteDifferenceStep();
    settings.fluidCouplesBodies = hydrodynamic && fluid->couplesBodies();
    settingsVersion = integrator->getSettingsVersion();
    settingsStepSize = h;
    printWarnings();
    if (settings.traits().isOverdamped()) return;
    for (auto& block : bodies.blocks) block.hasNoise = false;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        integrator->getBodyFriction(b, bath.gamma, bath.Gamma);
        bodies.setThermostat(b, hydrodynamic ? fluid->bodyThermostat(b, bodies.inertia(b), bath.kT, h)
                                             : schemeCoefficients(settings.scheme, bodies.inertia(b), bath, h));
    }
    bath.gamma = integrator->getFriction();
    vector<Thermostat> free;
    for (int i = 0; i < freeParticles->getNumParticles(); i++) {
        BodyInertia point;
        point.mass = freeParticles->mass(i);
        free.push_back(schemeCoefficients(settings.scheme, point, bath, h));
        if (hydrodynamic) fluid->freeThermostat(i, point.mass, bath.kT, h, free.back());
    }
    freeParticles->setThermostats(free);
}

void RigidBodyKernel::printWarnings() {
    for (const auto& warning : warnings())
        if (printedWarnings.insert(warning.first).second)
            cerr << "Warning: CustomRigidHIIntegrator: " << warning.second << endl;
}

map<RigidBodyKernel::WarningCause, string> RigidBodyKernel::warnings() const {
    map<WarningCause, string> result;
    const double kT = BOLTZ * integrator->getTemperature(), h = integrator->getStepSize();
    const SchemeTraits& traits = traitsOf(integrator->getScheme());
    const bool langevinA = traits.scheme == CustomRigidHIIntegrator::LangevinA;
    int unresolved = 0, firstUnresolved = -1;
    double worst = 0, largestGamma = integrator->getFriction(), largestRotational = integrator->getRotationalFriction();
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        double gamma, Gamma;
        integrator->getBodyFriction(b, gamma, Gamma);
        largestGamma = max(largestGamma, gamma);
        largestRotational = max(largestRotational, Gamma);
        if (bodies.rotor(b) != RotorKind::General) continue;
        const double* I = bodies.inertia(b).moments;
        const double turn = h * sqrt(kT * I[1] * I[2] / I[0]) * (1 / I[1] - 1 / I[2]);
        if (turn > resolutionLimit && unresolved++ == 0) firstUnresolved = b;
        worst = max(worst, turn);
    }
    if (traits.omitsDrift() && kT > 0 && fluid && fluid->hasStochasticDrift())
        result[WarningCause::OmittedDrift] =
            string(traits.name) +
            " omits the stochastic drift kT div N, which is not 0 here, and samples a wrong distribution; use "
            "RandomFiniteDifference, FixmanMidpoint, TrapezoidalSlip or DriftCorrectorRFD";
    if (unresolved > 0 && traits.hasMomenta)
        result[WarningCause::UnresolvedRotation] =
            "the step of " + number(h) + " ps does not resolve the rotation of " + to_string(unresolved) +
            " bodies, the first of them body " + to_string(firstUnresolved) +
            " (h sqrt(kT I2 I3/I1) (1/I2 - 1/I3) is up to " + number(worst) + ", above " + number(resolutionLimit) +
            "): their temperature will be wrong; take a step of " + number(h * resolutionLimit / worst) + " ps or less";
    if (langevinA && (largestGamma > langevinAGammaLimit || largestRotational > langevinARotationalLimit))
        result[WarningCause::LargeFriction] = "LangevinA breaks down at large friction (gamma " + number(largestGamma) +
                                              "/ps, limit about " + number(langevinAGammaLimit) + "; Gamma " +
                                              number(largestRotational) + "/ps, limit about " +
                                              number(langevinARotationalLimit) + "); use LangevinB or LangevinC";
    return result;
}

// ---------------------------------------------------------------------------------------------------------------------
// Taking in what others did to the Context

ParticleArrays RigidBodyKernel::arrays() {
    static_assert(sizeof(Vec3) == 3 * sizeof(double), "the loops take arrays of Vec3 as arrays of doubles");
    return {&positions()[0][0], &velocities()[0][0], &(*data.forces)[0][0], &lastPositions[0][0],
            &lastVelocities[0][0]};
}

LoopResult RigidBodyKernel::runLoop(BodyLoop loop) { return loops->run(loop, bodies, settings, arrays()); }

bool RigidBodyKernel::bodyMembersDiffer(int body, const vector<Vec3>& a, const vector<Vec3>& b) const {
    for (int p : definitions->getRigidBodyParticles(body))
        if (memcmp(&a[p], &b[p], sizeof(Vec3)) != 0) return true;
    return false;
}

void RigidBodyKernel::stateChanged(ContextImpl& context, State::DataType changed) {
    forcesAreValid = false;
    if (changed == State::Positions) {
        positionsAreSet = true;
        if (compareByHash) {
            // The positions of a checkpoint come after its bodies. Where they contradict, positions count.
            compareByHash = false;
            checkPosesAgainstPositions(*loaded);
            compareByHash = true;
        }
    }
    if (changed == State::Positions || changed == State::Velocities) userChangedState = true;
    if (changed == State::Velocities && !drawnTwists.empty()) {
        // setVelocitiesToTemperature(): particle velocities cannot tell the spin of one-site or linear bodies, so take
        // the twists that were drawn. (OpenMM then applies velocity constraints; what they change is taken in as
        // usual.)
        if (sameBits(velocities(), drawnVelocities)) {
            for (int b = 0; b < bodies.getNumBodies(); b++) {
                BodyState state = bodies.getState(b);
                state.p = drawnTwists[b].p;
                state.l = drawnTwists[b].l;
                bodies.setState(b, state);
            }
            lastVelocities = velocities();
        }
        drawnTwists.clear();
        drawnVelocities.clear();
    }
}

/** Bring poses and twists up to date with the Context's positions, velocities and box. */
void RigidBodyKernel::takeInChanges(ContextImpl& context, bool stepping) {
    if (!bodiesAreBuilt) deriveGeometries();
    Vec3 box[3];
    context.getPeriodicBoxVectors(box[0], box[1], box[2]);
    if (memcmp(box, lastBox, sizeof box) != 0) {
        forcesAreValid = false;
        memcpy(lastBox, box, sizeof box);
    }
    if (compareByHash) {
        // A state was loaded. Where the Context's arrays are those it was saved with, it stands as it is.
        if (hashOf(positions()) == loaded->positionsHash) lastPositions = positions();
        if (hashOf(velocities()) == loaded->velocitiesHash) lastVelocities = velocities();
        for (int b : bodiesOfOtherDefinition)
            for (int p : definitions->getRigidBodyParticles(b)) lastPositions[p] = lastVelocities[p] = unsetVec3;
        compareByHash = false;
        loaded.reset();
        membersNeedPuttingBack = true;
    }
    if (!sameBits(positions(), lastPositions)) takeInPositions();
    if (!sameBits(velocities(), lastVelocities)) takeInVelocities(stepping && settings.hasMomenta());
}

void RigidBodyKernel::takeInPositions() {
    vector<pair<int, BodyState> > fitted;
    double residual = 0;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        if (!bodyMembersDiffer(b, positions(), lastPositions)) continue;
        const vector<int>& particles = definitions->getRigidBodyParticles(b);
        vector<Vec3> members;
        for (int p : particles) {
            members.push_back(positions()[p]);
            if (!isFinite(members.back()))
                fail("body " + to_string(b) + ": particle " + to_string(p) +
                     " has a non-finite position; set finite positions");
        }
        // Virtual sites follow their parents, and users often leave them behind: they are put in place, not judged.
        BodyState state = bodies.getState(b);
        map<int, Vec3> positionOf;
        for (size_t i = 0; i < particles.size(); i++) positionOf[particles[i]] = members[i];
        for (size_t i = 0; i < particles.size(); i++)
            if (system->isVirtualSite(particles[i]))
                members[i] =
                    virtualSitePosition(*system, particles[i], [&](int parent) { return positionOf.at(parent); });
        int worst = 0;
        const double distance = fits[b].fitPose(members, state, worst);
        if (!(distance <= integrator->getPoseTolerance()))
            fail("body " + to_string(b) + ": particle " + to_string(particles[worst]) + " is " + number(distance) +
                 " nm from its place in the body, more than the pose tolerance " +
                 number(integrator->getPoseTolerance()) +
                 " nm; give positions that fit the body's shape: whole molecules, not wrapped across the periodic box; "
                 "where constraints define the shape, call applyConstraints() on the Context, elsewhere minimise with "
                 "openmmrigidhi.app.minimize(); raise setPoseTolerance(), or call resetBodyGeometry() if the shape "
                 "itself has changed");
        residual = max(residual, distance);
        fitted.emplace_back(b, state);
    }
    if (!fitted.empty()) {
        poseResidual = residual;
        membersNeedPuttingBack = true;
    }
    for (auto& bodyAndState : fitted) bodies.setState(bodyAndState.first, bodyAndState.second);
    if (fluid) fluid->forgetMemory();
    lastPositions = positions();
    forcesAreValid = false;
    // The twist is what the particles' velocities say at the new pose.
    for (auto& bodyAndState : fitted) takeInTwist(bodyAndState.first);
}

/** @param putBack  whether particle velocities may become those of rigid bodies now, or only when a step starts */
void RigidBodyKernel::takeInVelocities(bool putBack) {
    double sum = 0;
    for (const Vec3& v : velocities()) sum += v[0] + v[1] + v[2];
    for (int p = 0; !isfinite(sum) && p < (int)velocities().size(); p++)
        if (!isFinite(velocities()[p]))
            fail("particle " + to_string(p) +
                 (stock.bodyOfParticle[p] >= 0 ? " of body " + to_string(stock.bodyOfParticle[p]) : "") +
                 " has a non-finite velocity; set finite velocities");
    // A CMMotionRemover changes all velocities at every step: most bodies take the fast way, in one pass.
    runLoop(putBack ? BodyLoop::TakeInAndScatterVelocities : BodyLoop::TakeInVelocities);
    bool slowBodies = false;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        if (bodies.blocks[bodies.slot(b) / BodySet::blockSize].massesMakeTheBodies) continue;
        slowBodies = true;
        if (bodyMembersDiffer(b, velocities(), lastVelocities)) takeInTwist(b);
    }
    if (putBack && !slowBodies)
        for (int p : stock.otherParticles) lastVelocities[p] = velocities()[p];
    else {
        lastVelocities = velocities();
        velocitiesNeedPuttingBack = true;
    }
}

void RigidBodyKernel::takeInTwist(int b) {
    vector<Vec3> members;
    for (int p : definitions->getRigidBodyParticles(b)) members.push_back(velocities()[p]);
    Vec3 velocity, omega_lab = bodies.getAngularVelocity_lab(b);
    BodyState state = bodies.getState(b);
    fits[b].fitTwist(members, state, velocity, omega_lab);
    state.p = velocity * bodies.inertia(b).mass;
    bodies.setState(b, state);
    bodies.setAngularVelocity_lab(b, omega_lab);
}

void RigidBodyKernel::takeInVelocitiesIfChanged(ContextImpl& context) {
    // A barostat asks for the energy of trial positions: those are not to be taken in.
    if (!bodiesAreBuilt || compareByHash || !sameBits(velocities(), lastVelocities)) takeInChanges(context);
}

/** Members that others moved within the tolerance go back to their places. */
void RigidBodyKernel::putMembersBack(ContextImpl& context) {
    if (membersNeedPuttingBack)
        writePoses(context);
    else if (velocitiesNeedPuttingBack && settings.hasMomenta())
        runLoop(BodyLoop::ScatterVelocities);
    membersNeedPuttingBack = velocitiesNeedPuttingBack = false;
}

// ---------------------------------------------------------------------------------------------------------------------
// Momentum under a CMMotionRemover
//
// OpenMM's remover takes the momentum of the particles by the System's masses, and shifts the velocities of those with mass.
// That is right for bodies that these masses make. For others it would be another momentum, and a shift of some members
// only would turn the body. So where there are any the remover's work is undone, and done with the masses of the bodies.

bool RigidBodyKernel::massesAreTheSystems() const {
    for (const auto& block : bodies.blocks)
        if (!block.massesMakeTheBodies) return false;
    return true;
}

/** Whether a CMMotionRemover is due at this step that would be wrong. */
bool RigidBodyKernel::momentumIsOursToRemove() const {
    bool due = false;
    for (int frequency : stock.removalFrequencies) due = due || data.stepCount % frequency == 0;
    return due && !massesAreTheSystems();
}

/** Give particles the velocities they had before OpenMM's remover, if it alone has changed them since. */
void RigidBodyKernel::undoRemovalFromParticles() {
    const double rounding = 1e-12;  // of a few operations, beside velocities
    Vec3 shift;
    double mass = 0, largest = 0;
    for (size_t p = 0; p < velocitiesBeforeRemoval.size(); p++) {
        const Vec3& v = velocitiesBeforeRemoval[p];
        const double m = system->getParticleMass(p);
        shift += v * m;
        mass += m;
        largest = max(largest, abs(v[0]) + abs(v[1]) + abs(v[2]));
    }
    if (mass > 0) shift /= mass;
    for (size_t p = 0; p < velocitiesBeforeRemoval.size(); p++) {
        const Vec3 change = velocities()[p] - velocitiesBeforeRemoval[p],
                   unexplained = system->getParticleMass(p) > 0 ? change + shift : change;
        // Another Force has changed velocities too: its part cannot be told from the remover's, so both are kept.
        if (!(unexplained.dot(unexplained) <= rounding * rounding * largest * largest)) return;
    }
    velocities() = velocitiesBeforeRemoval;
}

/** Shift all velocities alike, so that the momentum of bodies and free particles is 0: rotation stays as it is. */
void RigidBodyKernel::removeMomentum() {
    Vec3 momentum;
    double mass = 0;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const int s = bodies.slot(b);
        momentum += Vec3(bodies.p[0][s], bodies.p[1][s], bodies.p[2][s]);
        mass += bodies.inertia(b).mass;
    }
    for (int i = 0; i < freeParticles->getNumParticles(); i++) {
        momentum += velocities()[freeParticles->getParticles()[i]] * freeParticles->mass(i);
        mass += freeParticles->mass(i);
    }
    if (mass == 0) return;
    const Vec3 shift = momentum / mass;
    for (int b = 0; b < bodies.getNumBodies(); b++)
        for (int k = 0; k < 3; k++) bodies.p[k][bodies.slot(b)] -= shift[k] * bodies.inertia(b).mass;
    for (int p : freeParticles->getParticles()) velocities()[p] -= shift;
    runLoop(BodyLoop::ScatterVelocities);
    for (int p : freeParticles->getParticles()) lastVelocities[p] = velocities()[p];
}

/** Write poses and twists to the Context's particles. */
void RigidBodyKernel::writePoses(ContextImpl& context) {
    runLoop(BodyLoop::ScatterPositions);
    if (settings.hasMomenta()) runLoop(BodyLoop::ScatterVelocities);
    placeFreeVirtualSites(context);
    rememberOtherParticles();
}

/** Virtual sites in bodies are placed with them; OpenMM places the others. */
void RigidBodyKernel::placeFreeVirtualSites(ContextImpl& context) {
    if (!stock.hasFreeVirtualSites) return;
    context.computeVirtualSites();
    // OpenMM has placed those in bodies too, differing by rounding: that is no change by others.
    for (int p : stock.virtualSites) lastPositions[p] = positions()[p];
}

void RigidBodyKernel::rememberOtherParticles() {
    for (int p : stock.otherParticles) {
        lastPositions[p] = positions()[p];
        lastVelocities[p] = velocities()[p];
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// Stepping

double RigidBodyKernel::now() {
    return chrono::duration<double>(chrono::steady_clock::now().time_since_epoch()).count();
}

void RigidBodyKernel::step(ContextImpl& context) {
    requirePositions("step()");
    if (bodiesAreBuilt) updateSettings();
    if (userChangedState || !bodiesAreBuilt || compareByHash) {
        // Before Forces that change the state (barostats) see it.
        takeInChanges(context, true);
        putMembersBack(context);
        userChangedState = false;
    }
    const bool removesMomentum = momentumIsOursToRemove();
    if (removesMomentum) {
        takeInChanges(context, true);
        velocitiesBeforeRemoval = velocities();
    }
    if (context.updateContextState()) forcesAreValid = false;
    const double start = now(), elsewhere = counters.seconds_forces + counters.seconds_mobility;
    if (removesMomentum) undoRemovalFromParticles();
    takeInChanges(context, true);
    putMembersBack(context);
    if (removesMomentum) removeMomentum();
    userChangedState = false;
    if (bodyForces.usesTime() && bodyForcesTime != data.time) forcesAreValid = false;
    if (forceChoice.changed(*system, integrator->getIntegrationForceGroups())) forcesAreValid = false;
    if (settings.traits().isOverdamped()) {
        if (!forcesAreValid && overdampedScheme(settings.scheme).needsForces(0)) evaluateForces(context);
    } else if (!forcesAreValid)
        evaluateForces(context);
    else if (bodyForces.usesVelocities() && settings.forcesAreGathered) {
        bodyForces.removeLast(bodies);
        addBodyForces(context, data.time, 0);
    }
    advance(context);
    data.time += settings.h;
    data.stepCount++;
    stepNumber++;
    counters.steps++;
    counters.seconds_scheme += now() - start - (counters.seconds_forces + counters.seconds_mobility - elsewhere);
}

void RigidBodyKernel::calculateForces(ContextImpl& context) {
    const double start = now();
    context.calcForcesAndEnergy(true, false, integrator->getIntegrationForceGroups());
    counters.seconds_forces += now() - start;
    counters.forceEvaluations++;
}

/** Forces at the present positions, where those of the last step do not serve. */
void RigidBodyKernel::evaluateForces(ContextImpl& context) {
    calculateForces(context);
    const bool freeFinite = freeParticles->gatherForces(*data.forces);
    const bool bodiesFinite = runLoop(BodyLoop::GatherForces).finite;
    if (!freeFinite || !bodiesFinite) reportNonFinite("force");
    addBodyForces(context, data.time, 0);
    forcesAreValid = true;
}

/** Add what CustomBodyForces give to the forces of the particles, which have been gathered. */
void RigidBodyKernel::addBodyForces(ContextImpl& context, double time, double lookAhead) {
    const int groups = integrator->getIntegrationForceGroups();
    settings.forcesAreGathered = bodyForces.isOn(groups);
    bodyForcesTime = time;
    if (settings.forcesAreGathered && !bodyForces.add(context, bodies, groups, time, lookAhead))
        reportNonFinite("force");
}

/** The scheme: from valid forces to new positions, velocities and valid forces; or an exception and nothing changed. */
void RigidBodyKernel::advance(ContextImpl& context) {
    settings.noise.seed = seed;
    settings.noise.step = stepNumber;
    settings.noise.attempt = 0;
    bodies.save(bodySnapshot);
    freeParticles->save(freeSnapshot, positions(), velocities());
    const auto putBack = [&] {
        if (fluid) fluid->restoreMemory();
        bodies.restore(bodySnapshot);
        freeParticles->restore(freeSnapshot, positions(), velocities());
        writePoses(context);
    };
    try {
        if (settings.traits().isOverdamped())
            takeOverdampedStep(context);
        else
            for (string objection; !(objection = attemptStep(context)).empty();) {
                putBack();
                counters.rejectedSteps++;
                settings.noise.attempt++;
                reportTooManyRejections(objection, settings.noise.attempt);
            }
        rememberOtherParticles();
    } catch (...) {
        if (settings.forcesAreGathered) forcesAreValid = false;  // what velocities and time they belong to is lost
        putBack();
        throw;
    }
}

/** A step that leads where the model has no mobility is redone with new noise, if that can help, and not for ever. What was rejected is
 * to be at its start again. */
void RigidBodyKernel::reportTooManyRejections(const string& objection, int attempts) {
    const int limit = integrator->getMaximumRejections();
    if (settings.kT > 0 && attempts <= limit) return;
    const string step = "step " + to_string(data.stepCount + 1) + ": ", where = step + objection;
    // Schemes that ask for no mobility at the start have not refused it.
    const string atStart = fluid->objection(bodies, positions());
    if (!atStart.empty()) fail(step + "it starts where the model has no mobility: " + atStart);
    if (settings.kT == 0)
        fail(where + "; at temperature 0 no other noise can help: take a smaller step, or add a repulsion");
    fail(where + "; the step was redone " + to_string(limit) +
         " times in a row, as often as setMaximumRejections() allows: take a smaller step, or add a stiffer repulsion");
}

/** @return why the step must be redone, or an empty string */
string RigidBodyKernel::attemptStep(ContextImpl& context) {
    const double tolerance = integrator->getConstraintTolerance();
    const bool mayObject = settings.fluidCouplesBodies && fluid->mayObject();
    LoopResult result;
    string objection;
    if (settings.fluidCouplesBodies)
        result = moveThroughFluid(tolerance);
    else {
        result = runLoop(BodyLoop::BeforeForces);
        result.add(freeParticles->beforeForces(settings, *loops, positions(), velocities(), tolerance));
    }
    if (!result.finite) reportNonFinite("position");
    counters.randomNumbers += result.randomNumbers;
    if (mayObject) objection = fluid->objection(bodies, positions());
    if (!objection.empty()) return objection;
    placeFreeVirtualSites(context);

    calculateForces(context);
    if (!freeParticles->gatherForces(*data.forces)) reportNonFinite("force");
    settings.forcesAreGathered = bodyForces.isOn(integrator->getIntegrationForceGroups());
    if (settings.forcesAreGathered) {
        if (!runLoop(BodyLoop::GatherForces).finite) reportNonFinite("force");
        // The velocities at the end of the kick by h/2 that the Langevin schemes have after the forces: then the two kicks
        // of a step are adjoint.
        addBodyForces(context, data.time + settings.h, settings.h / 2);
    }

    result = runLoop(BodyLoop::AfterForces);
    result.add(freeParticles->afterForces(settings, *loops, positions(), velocities(), tolerance));
    if (!result.finite) reportNonFinite("force");
    if (settings.fluidCouplesBodies) fluid->checkTorques(bodies, *data.forces);
    counters.randomNumbers += result.randomNumbers;
    // The next step's friction is taken half a step ahead, which no noise of that step can change.
    return mayObject ? objectionHalfAStepAhead(context, tolerance) : string();
}

string RigidBodyKernel::objectionHalfAStepAhead(ContextImpl& context, double tolerance) {
    if (bodyForces.usesVelocities() && settings.forcesAreGathered) {
        // The next step starts with forces for the velocities that the bodies have now, not for the predicted ones.
        bodyForces.removeLast(bodies);
        addBodyForces(context, data.time + settings.h, 0);
    }
    bodies.save(aheadBodies);
    freeParticles->save(aheadFree, positions(), velocities());
    runLoop(BodyLoop::BeforeFriction);
    freeParticles->beforeFriction(settings, *loops, positions(), velocities(), tolerance);
    const string objection = fluid->objection(bodies, positions());
    bodies.restore(aheadBodies);
    freeParticles->restore(aheadFree, positions(), velocities());
    return objection;
}

/** LangevinHI up to the force evaluation: half a step, the fluid at the poses there, the other half. */
LoopResult RigidBodyKernel::moveThroughFluid(double tolerance) {
    LoopResult result = runLoop(BodyLoop::BeforeFriction);
    result.add(freeParticles->beforeFriction(settings, *loops, positions(), velocities(), tolerance));
    if (!result.finite) reportNonFinite("position");
    // After a good step this is known to be empty; here what users set is judged.
    const string objection = fluid->objection(bodies, positions());
    if (!objection.empty()) {
        bodies.restore(bodySnapshot);
        freeParticles->restore(freeSnapshot, positions(), velocities());
        const string atStart = fluid->objection(bodies, positions());
        fail("step " + to_string(data.stepCount + 1) + ": " +
             (atStart.empty() ? "half a step ahead, where the friction is taken: " + objection : atStart));
    }
    const double start = now();
    result.add(
        fluid->relax(settings.h, settings.kT, settings.noise, bodies, *freeParticles, positions(), velocities()));
    counters.seconds_mobility += now() - start;
    result.add(runLoop(BodyLoop::AfterFriction));
    result.add(freeParticles->afterFriction(settings, *loops, positions(), velocities(), tolerance));
    return result;
}

void RigidBodyKernel::reportNonFinite(const char* what) {
    const string where = "step " + to_string(data.stepCount + 1) + ": ",
                 remedy =
                     "; the Context keeps the state before this step: look there for overlapping particles, or take a "
                     "smaller step";
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const BodyState state = bodies.getState(b);
        const bool pose = isFinite(state.R) && isfinite(state.q[0] + state.q[1] + state.q[2] + state.q[3]);
        if (pose && isFinite(bodies.getForce_lab(b)) && isFinite(bodies.getTorque_lab(b)) && isFinite(state.p) &&
            isFinite(state.l))
            continue;
        fail(where + "body " + to_string(b) + " (first particle " +
             to_string(definitions->getRigidBodyParticles(b)[0]) + ") has a non-finite " +
             (pose ? "force, torque or momentum" : "position or orientation") + remedy);
    }
    for (int i = 0; i < freeParticles->getNumParticles(); i++) {
        const int p = freeParticles->getParticles()[i];
        if (!isFinite(freeParticles->getForce(i)) || !isFinite(positions()[p]) || !isFinite(velocities()[p]))
            fail(where + "free particle " + to_string(p) + " has a non-finite " + what + " or velocity" + remedy);
    }
    fail(where + "a non-finite " + what + " was found" + remedy);
}

}  // namespace RigidHIPlugin
