#include "context/SystemCheck.h"

#include <openmm/AndersenThermostat.h>
#include <openmm/CMMotionRemover.h>
#include <openmm/MonteCarloAnisotropicBarostat.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/MonteCarloMembraneBarostat.h>
#include <openmm/System.h>
#include <openmm/VirtualSite.h>

#include <cmath>
#include <map>
#include <set>
#include <typeinfo>

#include "context/Messages.h"
#include "host/StepSettings.h"
#include "mobility/Models.h"
#include "openmmrigidhi/MobilityForce.h"
#include "rigidbody/VirtualSitePosition.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

string particleText(int p) { return "particle " + to_string(p); }
string bodyText(int b) { return "body " + to_string(b); }

/**
 * Whether a barostat moves particles of one molecule relative to each other. Barostats before
 * OpenMM 8.6 do not move them so, and lack this method.
 */
template <class Barostat>
auto deformsMolecules(const Barostat& barostat, int)
    -> decltype(!barostat.getScaleMoleculesAsRigid()) {
    return !barostat.getScaleMoleculesAsRigid();
}
template <class Barostat>
bool deformsMolecules(const Barostat&, long) {
    return false;
}

void checkTies(const System& system, const vector<int>& bodyOf) {
    for (int i = 0; i < system.getNumConstraints(); i++) {
        int a, b;
        double distance;
        system.getConstraintParameters(i, a, b, distance);
        if (bodyOf[a] != bodyOf[b]) {
            const int inside = bodyOf[a] >= 0 ? a : b, outside = inside == a ? b : a;
            fail("constraint " + to_string(i) + " ties " + particleText(inside) + " of " +
                 bodyText(bodyOf[inside]) + " to " + particleText(outside) +
                 " outside it; a body moves as a whole: add both particles to one body or remove "
                 "the constraint");
        }
    }
    for (int i = 0; i < system.getNumParticles(); i++) {
        if (!system.isVirtualSite(i)) continue;
        const VirtualSite& site = system.getVirtualSite(i);
        for (int k = 0; k < site.getNumParticles(); k++) {
            const int parent = site.getParticle(k);
            const auto owner = [&](int p) {
                return bodyOf[p] >= 0 ? " of " + bodyText(bodyOf[p]) : string();
            };
            if ((bodyOf[i] >= 0 || bodyOf[parent] >= 0) && !turnsWithItsParents(site))
                fail("virtual site " + particleText(i) + owner(i) + " is a " + kindOf(site) +
                     " defined by " + particleText(parent) + owner(parent) +
                     ", a kind that need not turn with a body; use a TwoParticleAverageSite, "
                     "ThreeParticleAverageSite, OutOfPlaneSite or LocalCoordinatesSite, or make "
                     "the particle a massless member of the body that is no virtual site");
            if (bodyOf[parent] == bodyOf[i]) continue;
            fail("virtual site " + particleText(i) + owner(i) + " depends on " +
                 particleText(parent) +
                 (bodyOf[parent] >= 0 ? " of " + bodyText(bodyOf[parent]) : " outside the body") +
                 "; a virtual site and the particles that define it belong in one body: add all of "
                 "them to it (for water, give addRigidWater() the System)");
        }
    }
}

void checkMolecules(const ContextImpl& context, const CustomRigidHIIntegrator& integrator,
                    const string& barostat) {
    if (!context.getSystem().usesPeriodicBoundaryConditions() && barostat.empty()) return;
    vector<int> moleculeOf(context.getSystem().getNumParticles());
    const auto& molecules = context.getMolecules();
    for (size_t m = 0; m < molecules.size(); m++)
        for (int p : molecules[m]) moleculeOf[p] = m;
    for (int b = 0; b < integrator.getNumRigidBodies(); b++) {
        const vector<int>& particles = integrator.getRigidBodyParticles(b);
        for (int p : particles)
            if (moleculeOf[p] != moleculeOf[particles[0]])
                fail(bodyText(b) + ": " + particleText(particles[0]) + " and " + particleText(p) +
                     " are in different molecules, so OpenMM would tear the body apart at the "
                     "periodic boundary; tie them with bonds or constraints, or call "
                     "openmmrigidhi.app.bindBodies(system, integrator)");
    }
}

/**
 * Whether masses are those of water, amu: an oxygen and two equal hydrogens, also heavy ones, or
 * hydrogens that have taken mass from the oxygen.
 */
bool areMassesOfWater(double heavy, double light, double other) {
    const double water = 18.015, rounding = 0.05;
    const bool hasOxygen = heavy > 15 && heavy < 18.5,
               isRepartitioned = abs(heavy + 2 * light - water) < rounding;
    return light == other && light > 0.9 && light < 4.1 && (hasOxygen || isRepartitioned);
}

/**
 * Rigid waters that are in no body: molecules of three particles with three constraints, which have
 * the masses and the symmetry of water.
 */
void findFreeWaters(const System& system, SystemInventory& stock) {
    map<int, map<int, double>> tied;  // particle, partner, distance
    for (int i = 0; i < system.getNumConstraints(); i++) {
        int a, b;
        double distance;
        system.getConstraintParameters(i, a, b, distance);
        if (stock.bodyOfParticle[a] >= 0) continue;
        tied[a][b] = tied[b][a] = distance;
    }
    for (const auto& entry : tied) {
        const int heavy = entry.first;
        if (entry.second.size() != 2) continue;
        const int a = entry.second.begin()->first, b = entry.second.rbegin()->first;
        if (tied[a].size() != 2 || tied[b].size() != 2 || tied[a].count(b) == 0 ||
            !areMassesOfWater(system.getParticleMass(heavy), system.getParticleMass(a),
                              system.getParticleMass(b)) ||
            entry.second.at(a) != entry.second.at(b))
            continue;
        if (stock.numFreeWaters++ == 0) stock.firstFreeWater = heavy;
    }
}

bool seenByFluid(const SystemInventory& stock, int particle) {
    return stock.mobilityForce && particle < stock.mobilityForce->getNumParticles() &&
           stock.mobilityForce->getParticleRadius(particle) > 0;
}

}  // namespace

SystemInventory takeStock(const ContextImpl& context, const CustomRigidHIIntegrator& integrator) {
    const System& system = context.getSystem();
    const int numParticles = system.getNumParticles();
    SystemInventory stock;
    stock.bodyOfParticle.assign(numParticles, -1);
    for (int i = 0; i < system.getNumForces(); i++)
        if (auto* mobility = dynamic_cast<const MobilityForce*>(&system.getForce(i))) {
            stock.mobilityForce = mobility;
            stock.numMobilityForces++;
        }
    for (int b = 0; b < integrator.getNumRigidBodies(); b++)
        for (int p : integrator.getRigidBodyParticles(b)) {
            if (p >= numParticles)
                fail(bodyText(b) + ": particle index " + to_string(p) +
                     " is out of range; the System has " + to_string(numParticles) +
                     " particles, 0 to " + to_string(numParticles - 1) +
                     ": build the body from particles of this System");
            stock.bodyOfParticle[p] = b;
        }
    for (int p = 0; p < numParticles; p++) {
        if (system.isVirtualSite(p)) stock.virtualSites.push_back(p);
        if (stock.bodyOfParticle[p] >= 0) continue;
        stock.otherParticles.push_back(p);
        if (system.getParticleMass(p) > 0 || (seenByFluid(stock, p) && !system.isVirtualSite(p)))
            stock.freeParticles.push_back(p);
        if (system.isVirtualSite(p)) stock.hasFreeVirtualSites = true;
    }
    checkTies(system, stock.bodyOfParticle);
    for (int i = 0; i < system.getNumConstraints(); i++) {
        int a, b;
        double distance;
        system.getConstraintParameters(i, a, b, distance);
        if (stock.bodyOfParticle[a] < 0 && system.getParticleMass(a) > 0)
            stock.numFreeConstraints++;
    }
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        // DrudeForce is in a plugin of OpenMM that this library does not otherwise need. The name
        // of its type therefore identifies it.
        if (string(typeid(force).name()).find("DrudeForce") != string::npos)
            fail("force " + to_string(i) +
                 ", a DrudeForce, needs an integrator for Drude particles; remove it, or use "
                 "OpenMM's DrudeLangevinIntegrator");
        if (dynamic_cast<const AndersenThermostat*>(&force))
            fail("force " + to_string(i) +
                 ", an AndersenThermostat, changes velocities of single particles and so breaks "
                 "rigid bodies; remove it: this integrator is a thermostat itself");
        if (auto* remover = dynamic_cast<const CMMotionRemover*>(&force)) {
            stock.hasCMMotionRemover = true;
            stock.removalFrequencies.push_back(remover->getFrequency());
        }
        const auto look = [&](auto* barostat, const char* name) {
            if (barostat == nullptr) return;
            stock.barostat = name;
            stock.barostatTemperature = barostat->Temperature();
            if (deformsMolecules(*barostat, 0))
                fail("force " + to_string(i) + ", a " + name +
                     ", scales the particles of a molecule independently, and so deforms rigid "
                     "bodies; call its setScaleMoleculesAsRigid(true)");
        };
        look(dynamic_cast<const MonteCarloBarostat*>(&force), "MonteCarloBarostat");
        look(dynamic_cast<const MonteCarloAnisotropicBarostat*>(&force),
             "MonteCarloAnisotropicBarostat");
        look(dynamic_cast<const MonteCarloMembraneBarostat*>(&force), "MonteCarloMembraneBarostat");
        if (string(typeid(force).name()).find("MonteCarloFlexibleBarostat") != string::npos)
            fail("force " + to_string(i) +
                 ", a MonteCarloFlexibleBarostat, may deform rigid bodies; use a "
                 "MonteCarloBarostat, MonteCarloAnisotropicBarostat or MonteCarloMembraneBarostat");
    }
    checkMolecules(context, integrator, stock.barostat);
    findFreeWaters(system, stock);
    return stock;
}

void checkBoundary(const MobilityForce& force, const CustomRigidHIIntegrator& integrator) {
    constexpr ErrorsOf fail{"MobilityForce"};
    if (!hasBoundary(force.getModel(), force.getBoundary())) {
        const string models = namesIn(modelTable, " or ", [&](const ModelTraits& model) {
            return model.hasBoundary(force.getBoundary());
        });
        const string boundaries = namesIn(boundaryTable, " or ", [&](const BoundaryTraits& traits) {
            return hasBoundary(force.getModel(), traits.boundary);
        });
        fail(string("boundary ") + boundaryName(force.getBoundary()) +
             " can be used with the model " + models + ", not with " + modelName(force.getModel()) +
             "; use setModel(" + models + ") or setBoundary(" + boundaries + ")");
    }
    const BoundaryTraits& traits = traitsOf(force.getBoundary());
    if (traits.numWalls == 2) {
        double low, high;
        force.getChannelWalls(low, high);
        if (!(low < high))
            fail(string("boundary ") + traits.name + " has walls at " + "xyz"[traits.wallAxis] +
                 " = 0 and 0 nm, where the first must be below the second; set them by "
                 "setChannelWalls()");
    }
    if (force.getSphereWallMobility() != MobilityForce::BestKnown) return;
    if (force.getBoundary() != MobilityForce::NoSlipWall &&
        force.getBoundary() != MobilityForce::PeriodicWall)
        fail(string("sphere-wall mobility BestKnown is for the boundaries NoSlipWall and "
                    "PeriodicWall, but the boundary ") +
             boundaryName(force.getBoundary()) +
             (traits.hasWalls() ? " has other planes" : " has no wall") +
             "; use setBoundary(NoSlipWall) or setSphereWallMobility(FromModel)");
    if (integrator.getWallRejection() == CustomRigidHIIntegrator::Crossing)
        fail(
            "sphere-wall mobility BestKnown is known only for spheres that do not overlap the "
            "wall, so it cannot be used with the wall rejection Crossing; use "
            "setWallRejection(Overlap) or setSphereWallMobility(FromModel)");
    if (force.getModel() != MobilityForce::RotnePragerYamakawa)
        fail(string("sphere-wall mobility BestKnown is for the model RotnePragerYamakawa, but the "
                    "model is ") +
             modelName(force.getModel()) +
             "; use setModel(RotnePragerYamakawa) or setSphereWallMobility(FromModel) (with "
             "setLubrication(On) if spheres are to have lubrication at the wall)");
}

void checkSlips(const MobilityForce& force, const CustomRigidHIIntegrator& integrator) {
    const SchemeTraits& traits = traitsOf(integrator.getScheme());
    const vector<int> bodies = force.getBodiesWithSlip();
    if (traits.isOverdamped()) return;
    if (force.getNumBodyForcesOnFluid() > 0)
        fail(string("a body exerts a force on the fluid (addBodyForceOnFluid()), which scheme ") +
             traits.name +
             " would ignore; use a scheme without momenta in a fluid, such as TrapezoidalSlip, or "
             "make a MobilityForce without this force");
    if (bodies.empty()) return;
    fail(bodyText(bodies[0]) + " has a slip (setBodySlip()), which scheme " + traits.name +
         " would ignore; use a scheme without momenta in a fluid, such as TrapezoidalSlip, or take "
         "the slip away by clearBodySlip()");
}

void checkShear(const MobilityForce& force, const CustomRigidHIIntegrator& integrator) {
    constexpr ErrorsOf fail{"MobilityForce"};
    double rate;
    int flowAxis, gradientAxis;
    force.getShear(rate, flowAxis, gradientAxis);
    if (rate == 0) return;
    const SchemeTraits& traits = traitsOf(integrator.getScheme());
    if (!traits.isOverdamped())
        fail("a shear (setShear()) of the rate " + number(rate) +
             "/ps needs a scheme without momenta, and the scheme is " + traits.name +
             "; use setScheme() with one such as TractionEulerMaruyama, or setShear() with "
             "the rate 0");
}

/** Check that each particle that is held can be held. */
static void checkHeldParticles(const System& system, const CustomRigidHIIntegrator& integrator,
                               const SystemInventory& stock) {
    for (int p : integrator.getHeldParticles()) {
        const string held = particleText(p) + " is held, but ";
        if (p >= system.getNumParticles())
            fail(held + "the System has " + to_string(system.getNumParticles()) +
                 " particles, numbered from 0; let it go by setParticleHeld(" + to_string(p) +
                 ", false)");
        if (stock.bodyOfParticle[p] >= 0)
            fail(held + "is in " + bodyText(stock.bodyOfParticle[p]) +
                 "; hold the body by setBodyHeld()");
        if (system.isVirtualSite(p))
            fail(held +
                 "is a virtual site, which follows the particles that define it; hold those "
                 "particles");
    }
    for (int i = 0; i < system.getNumConstraints(); i++) {
        int a, b;
        double distance;
        system.getConstraintParameters(i, a, b, distance);
        for (int p : {a, b})
            if (integrator.getParticleHeld(p))
                fail("constraint " + to_string(i) + " ties " + particleText(p) +
                     ", which is held, to " + particleText(p == a ? b : a) +
                     "; make the molecule a body and hold the body, or let the particle go");
    }
}

/** Check that the scheme and the rest of the System allow what is held. */
static void checkHeld(const System& system, const CustomRigidHIIntegrator& integrator,
                      const SystemInventory& stock) {
    checkHeldParticles(system, integrator, stock);
    const int numBodies = integrator.getNumRigidBodies(), numParticles = stock.freeParticles.size();
    int heldBodies = 0, heldParticles = 0;
    string held;  // the first object that is held
    for (int b = 0; b < numBodies; b++)
        if (integrator.getBodyHeld(b) && heldBodies++ == 0) held = bodyText(b);
    for (int p : stock.freeParticles) heldParticles += integrator.getParticleHeld(p);
    if (held.empty() && !integrator.getHeldParticles().empty())
        held = particleText(integrator.getHeldParticles()[0]);
    if (held.empty()) return;
    if (heldBodies == numBodies && heldParticles == numParticles)
        fail("everything is held (" + counted(numBodies, "body", "bodies") + " and " +
             counted(numParticles, "free particle", "free particles") +
             "), so that nothing would move; let something go by setBodyHeld(index, false) or "
             "setParticleHeld(particle, false). For a body at rest in a flow, take a "
             "CustomBodyMotion with six zeros, which holds a body alone, too");
    if (!stock.barostat.empty())
        fail(held + " is held, but the System has a " + stock.barostat +
             ", which would move it; remove the barostat, or let " + held + " go");
    if (stock.hasCMMotionRemover)
        fail(held +
             " is held, so that momentum is not conserved, but the System has a CMMotionRemover; "
             "create the System with removeCMMotion=False, or remove the force");
}

/** Check the motions that CustomBodyMotions prescribe. */
static void checkPrescribed(const CustomRigidHIIntegrator& integrator, const SystemInventory& stock,
                            const SchemeTraits& traits) {
    for (const auto& [b, components] : stock.prescribed) {
        const string motion =
            "a CustomBodyMotion (force " + to_string(components.force) + ") prescribes ";
        if (integrator.getBodyHeld(b))
            fail(bodyText(b) + " is held, but " + motion +
                 "its motion; let the body go, or remove it from the force");
        if (traits.isOverdamped()) continue;
        if (traits.kind != SchemeKind::FluidThermostat)
            fail(motion + "the motion of " + bodyText(b) + ", which scheme " + traits.name +
                 " cannot do; use a scheme without momenta in a fluid, such as TrapezoidalSlip, or "
                 "hold the body by setBodyHeld()");
        if (!components.areAll())
            fail(motion + components.names() + " of " + bodyText(b) + ", but scheme " +
                 traits.name +
                 " takes prescribed motion of whole bodies only; prescribe the other components "
                 "too ('0': at rest), or use a scheme without momenta in a fluid, such as "
                 "TrapezoidalSlip");
    }
}

/** What holds a body or prescribes its motion, whatever the forces on it; empty if nothing. */
static string motionIsGiven(const CustomRigidHIIntegrator& integrator, const SystemInventory& stock,
                            int b) {
    if (integrator.getBodyHeld(b)) return bodyText(b) + " is held";
    const auto prescribed = stock.prescribed.find(b);
    if (prescribed == stock.prescribed.end() || !prescribed->second.areAll()) return "";
    return "a CustomBodyMotion (force " + to_string(prescribed->second.force) +
           ") prescribes all six components of " + bodyText(b);
}

/** Check that the bodies of a joint are in one group. */
static void checkGroupOf(const JointDefinition& joint, const string& name,
                         const MobilityForce& fluid) {
    if (fluid.getModel() == MobilityForce::FreeDraining)
        fail(name +
             " needs both bodies in one group, but under FreeDraining every body is in a group of "
             "its own; use setModel(RotnePragerYamakawa)");
    const vector<int>& groups = fluid.getGroups();
    // GroupBuilder checks the number of groups.
    if (max(joint.i, joint.j) < static_cast<int>(groups.size()) &&
        groups[joint.i] != groups[joint.j])
        fail(name + " needs both bodies in one group, but they are in groups " +
             to_string(groups[joint.i]) + " and " + to_string(groups[joint.j]) +
             " of MobilityForce::setGroups(); give both bodies the same group, or leave the joint "
             "out");
}

/** Check that the scheme and the rest of the System allow the joints. */
static void checkJoints(const CustomRigidHIIntegrator& integrator, const SystemInventory& stock,
                        const SchemeTraits& traits) {
    const vector<JointDefinition>& joints = integrator.getJoints();
    if (joints.empty()) return;
    const string why = traits.whyNoJoints();
    if (!why.empty())
        fail("the integrator has " + jointText(0, joints[0]) + ", but scheme " + traits.name +
             " has no joints: " + why +
             "; use TrapezoidalSlip, FixmanMidpoint or RandomFiniteDifference, or leave the joints "
             "out");
    if (!stock.barostat.empty())
        fail("the integrator has " + jointText(0, joints[0]) + ", but the System has a " +
             stock.barostat +
             ", which moves every molecule by itself and so would tear the joint; remove the "
             "barostat");
    for (size_t k = 0; k < joints.size(); k++) {
        const JointDefinition& joint = joints[k];
        const string name = jointText(k, joint), first = motionIsGiven(integrator, stock, joint.i);
        if (joint.kind == JointDefinition::BallToPoint) {
            if (!first.empty())
                fail(name + " has nothing that it could move: " + first +
                     "; leave the joint out, or let the body go");
            continue;
        }
        const string second = motionIsGiven(integrator, stock, joint.j);
        if (!first.empty() && !second.empty())
            fail(name + " has no body that it could move: " + first + ", and " + second +
                 "; leave the joint out, or let one of the bodies go");
        checkGroupOf(joint, name, *stock.mobilityForce);
    }
}

/**
 * Checks that depend on inertia: schemes with momenta need inertia everywhere, and
 * GradientThermostat needs it in its rates.
 */
static void checkMasses(const System& system, const CustomRigidHIIntegrator& integrator,
                        const SystemInventory& stock, const string& name) {
    for (int b = 0; b < integrator.getNumRigidBodies(); b++) {
        const auto prescribed = stock.prescribed.find(b);
        if (integrator.getBodyHeld(b) ||
            (prescribed != stock.prescribed.end() && prescribed->second.areAll()))
            continue;
        double mass = 0;
        if (integrator.getRigidBodyIsExplicit(b)) {
            vector<int> particles;
            Vec3 moments;
            vector<Vec3> sites;
            integrator.getRigidBodyParameters(b, particles, mass, moments, sites);
        } else
            for (int p : integrator.getRigidBodyParticles(b)) mass += system.getParticleMass(p);
        if (mass == 0)
            fail(bodyText(b) + " has mass 0, but scheme " + name +
                 " needs a positive mass; give its particles masses in the System, or add the body "
                 "with explicit mass, moments and site positions. A body without mass needs a "
                 "scheme without momenta such as FixmanMidpoint, with a MobilityForce (for Monte "
                 "Carlo too)");
    }
    for (int p : stock.freeParticles)
        if (system.getParticleMass(p) == 0 && !integrator.getParticleHeld(p))
            fail(particleText(p) + " has hydrodynamic radius " +
                 to_string(stock.mobilityForce->getParticleRadius(p)) +
                 " nm but is in no body and has no mass, which scheme " + name +
                 " needs; give it a mass, make it part of a body, or give it radius 0");
}

/** Check that the fluid resists the motion of all particles that move. */
static void checkOverdamped(const CustomRigidHIIntegrator& integrator, const SystemInventory& stock,
                            const string& name) {
    for (int p : stock.freeParticles)
        if (!seenByFluid(stock, p) && !integrator.getParticleHeld(p))
            fail(particleText(p) + " is in no body and has hydrodynamic radius 0, so scheme " +
                 name +
                 " has no mobility for it; give it a radius with MobilityForce.addParticle(), "
                 "make it part of a body, or hold it where it is by setParticleHeld()");
}

/** Refuse Forces and settings that a scheme without velocities does not support. */
static void checkNoMomenta(const SystemInventory& stock, const string& name,
                           const string& instead) {
    if (!stock.velocityDependentForce.empty())
        fail(stock.velocityDependentForce + ", depends on vx, vy or vz, but scheme " + name +
             " has no velocities; use a Langevin scheme, or expressions without velocities");
    if (stock.numFreeConstraints > 0)
        fail("the System has " + to_string(stock.numFreeConstraints) +
             " constraints between particles that are in no body; scheme " + name +
             " allows none: make rigid groups bodies, or use " + instead);
    if (stock.hasCMMotionRemover)
        fail("the System has a CMMotionRemover, but scheme " + name +
             " has no momenta to remove; create the System with removeCMMotion=False, or remove "
             "the force");
    if (!stock.barostat.empty())
        fail("the System has a " + stock.barostat +
             ", which is supported with the schemes LangevinA, LangevinB and LangevinC only, not "
             "with " +
             name + "; change the scheme or remove the barostat");
}

void checkScheme(const System& system, const CustomRigidHIIntegrator& integrator,
                 const SystemInventory& stock) {
    const CustomRigidHIIntegrator::Scheme scheme = integrator.getScheme();
    const SchemeTraits& traits = traitsOf(scheme);
    const string name = traits.name;
    const bool hydrodynamic = traits.needsFluid();
    if (hydrodynamic && stock.numMobilityForces != 1)
        fail("the System has " + to_string(stock.numMobilityForces) +
             " MobilityForces, but scheme " + name +
             " needs exactly one; add a MobilityForce to the System, or keep only one");
    if (!hydrodynamic && stock.numMobilityForces > 0)
        fail("the System has a MobilityForce, which scheme " + name +
             " would ignore; use LangevinHI or a scheme without momenta, or remove the "
             "MobilityForce");
    // Check prescribed motion and joints first: their remedies differ from those of what the scheme
    // cannot do even without them.
    checkPrescribed(integrator, stock, traits);
    checkJoints(integrator, stock, traits);
    if (traits.isOverdamped())
        checkOverdamped(integrator, stock, name);
    else
        checkMasses(system, integrator, stock, name);
    if (!traits.hasMomenta) checkNoMomenta(stock, name, hydrodynamic ? "LangevinHI" : "LangevinC");
    checkHeld(system, integrator, stock);
    if (stock.mobilityForce) checkSlips(*stock.mobilityForce, integrator);
    if (stock.mobilityForce) checkShear(*stock.mobilityForce, integrator);
    if (traits.kind == SchemeKind::FluidThermostat) {
        if (stock.hasCMMotionRemover)
            fail("the System has a CMMotionRemover, but with scheme " + name +
                 " the fluid exchanges momentum with the bodies; create the System with "
                 "removeCMMotion=False, or remove the force");
        if (!stock.barostat.empty())
            fail("the System has a " + stock.barostat + ", which scheme " + name +
                 " does not support: the fluid has no pressure that could balance it; remove the "
                 "barostat, or use LangevinC");
        for (int i = 0; i < system.getNumConstraints(); i++) {
            int a, b;
            double distance;
            system.getConstraintParameters(i, a, b, distance);
            for (int p : {a, b})
                if (stock.bodyOfParticle[p] < 0 && p < stock.mobilityForce->getNumParticles() &&
                    stock.mobilityForce->getParticleRadius(p) > 0)
                    fail("constraint " + to_string(i) + " holds " + particleText(p) +
                         ", which is in no body and has a hydrodynamic radius; scheme " + name +
                         " allows constraints only between free particles without such a radius: "
                         "make the molecule of this particle a rigid body, or set the radius of "
                         "the particle to 0");
        }
    }
}

}  // namespace RigidHIPlugin
