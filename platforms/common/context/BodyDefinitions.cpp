#include "context/BodyDefinitions.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "context/Messages.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Hold the bodies and particles that another integrator holds. It may have more bodies. */
void copyHeld(const CustomRigidHIIntegrator& from, CustomRigidHIIntegrator& to) {
    for (int b = 0; b < to.getNumRigidBodies(); b++) to.setBodyHeld(b, from.getBodyHeld(b));
    for (int p : to.getHeldParticles()) to.setParticleHeld(p, false);
    for (int p : from.getHeldParticles()) to.setParticleHeld(p, true);
}

/** An integrator that is bound to no Context, with the scheme, bodies and joints of another. */
unique_ptr<CustomRigidHIIntegrator> copyDefinitions(const CustomRigidHIIntegrator& from) {
    auto to = make_unique<CustomRigidHIIntegrator>(from.getTemperature(), from.getStepSize());
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
    copyHeld(from, *to);
    for (const JointDefinition& joint : from.getJoints()) to->addJoint(joint);
    for (const HingeMotorDefinition& motor : from.getHingeMotors())
        to->addHingeMotor(motor.hinge, motor.rate);
    return to;
}

}  // namespace

BodyDefinitions::BodyDefinitions(const CustomRigidHIIntegrator& integrator, const System& system)
    : integrator(integrator), system(system), definitions(copyDefinitions(integrator)) {}

const CustomRigidHIIntegrator& BodyDefinitions::underPresentScheme() {
    definitions->setScheme(integrator.getScheme());
    copyHeld(integrator, *definitions);
    return *definitions;
}

vector<HingeMotorDefinition> BodyDefinitions::motors() const {
    vector<HingeMotorDefinition> result = definitions->getHingeMotors();
    for (size_t m = 0; m < result.size(); m++) result[m].rate = integrator.getHingeMotors()[m].rate;
    return result;
}

vector<vector<int>> BodyDefinitions::particlesOfBodies() const {
    vector<vector<int>> result;
    for (int b = 0; b < getNumBodies(); b++) result.push_back(particles(b));
    return result;
}

bool BodyDefinitions::areAllKnown() const {
    for (int b = 0; b < getNumBodies(); b++)
        if (!isKnown(b)) return false;
    return true;
}

BodyGeometryBuilder BodyDefinitions::builder(int b) const {
    return BodyGeometryBuilder(system, *constraints, particles(b), "body " + to_string(b));
}

void BodyDefinitions::takeFromSystem() {
    constraints = make_unique<ConstraintsOfParticles>(system);
    geometries_.resize(getNumBodies());
    for (int b = 0; b < getNumBodies(); b++) {
        const bool known = isKnown(b);
        vector<int> members;
        BodyGeometry& g = geometries_[b];
        if (known) definitions->getRigidBodyParameters(b, members, g.mass, g.moments, g.sites);
        if (isExplicit(b)) continue;
        // The System takes precedence: a known shape stays only as far as the System leaves it
        // open, and with the System's masses.
        const BodyGeometryBuilder bySystem = builder(b);
        if (known || !bySystem.needsPositions()) {
            g = bySystem.update(g);
            record(b, g);
        }
    }
}

vector<BodyGeometry> BodyDefinitions::fromPositions(const vector<Vec3>& positions) const {
    vector<BodyGeometry> result = geometries_;
    for (int b = 0; b < getNumBodies(); b++) {
        if (isKnown(b)) continue;
        vector<Vec3> members;
        for (int p : particles(b)) members.push_back(positions[p]);
        result[b] = builder(b).build(members);
    }
    return result;
}

BodyGeometry BodyDefinitions::updateBySystem(int b, const BodyGeometry& known) const {
    return builder(b).update(known);
}

/**
 * Record a shape that has become known. Record it in the integrator too, unless a user has
 * meanwhile given the integrator another definition of the body.
 */
void BodyDefinitions::record(int b, const BodyGeometry& g) {
    definitions->recordBodyGeometry(b, g.mass, g.moments, g.sites);
    if (!integrator.getRigidBodyIsExplicit(b) &&
        integrator.getRigidBodyParticles(b) == particles(b))
        integrator.recordBodyGeometry(b, g.mass, g.moments, g.sites);
}

void BodyDefinitions::checkVirtualSites(int b, const BodyGeometry& g) const {
    const vector<int>& members = particles(b);
    if (none_of(members.begin(), members.end(),
                [&](int particle) { return system.isVirtualSite(particle); }))
        return;
    map<int, Vec3> siteOfParticle;
    for (size_t i = 0; i < members.size(); i++) siteOfParticle[members[i]] = g.sites[i];
    for (size_t i = 0; i < members.size(); i++) {
        if (!system.isVirtualSite(members[i])) continue;
        const Vec3 off = g.sites[i] - virtualSitePosition(system, members[i], [&](int parent) {
                             return siteOfParticle.at(parent);
                         });
        const double distance = sqrt(off.dot(off));
        if (!(distance <= siteTolerance()))
            fail("body " + to_string(b) + ": the site given for particle " + to_string(members[i]) +
                 " is " + number(distance) +
                 " nm from where the System's virtual site puts it, more than half of the pose "
                 "tolerance, " +
                 number(siteTolerance()) + " nm; mend the site position or the virtual site");
    }
}

BodyDefinitions::Bodies BodyDefinitions::build(const vector<BodyGeometry>& geometries,
                                               const vector<bool>& withoutMomenta) const {
    const int n = getNumBodies();
    vector<vector<double>> siteMasses(n);
    vector<vector<bool>> carriesForce(n);
    Bodies result;
    result.geometries = geometries;
    result.fits.reserve(n);
    for (int b = 0; b < n; b++) {
        vector<double> masses;
        vector<bool> isVirtual;
        for (int p : particles(b)) {
            masses.push_back(system.getParticleMass(p));
            isVirtual.push_back(system.isVirtualSite(p));
            carriesForce[b].push_back(!isVirtual.back());
        }
        checkVirtualSites(b, geometries[b]);
        result.fits.emplace_back(geometries[b], masses, isVirtual);
        if (result.fits.back().massesMakeTheBody(geometries[b], masses)) siteMasses[b] = masses;
    }
    result.set = BodySet(geometries, particlesOfBodies(), siteMasses, carriesForce, withoutMomenta);
    return result;
}

void BodyDefinitions::exchange(Bodies& others) {
    swap(geometries_, others.geometries);
    swap(fits, others.fits);
}

}  // namespace RigidHIPlugin
