#include "openmmrigidhi/CustomRigidHIIntegrator.h"

#include <openmm/OpenMMException.h>
#include <openmm/Platform.h>
#include <openmm/internal/ContextImpl.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <unordered_set>

#include "openmmrigidhi/RigidHIKernels.h"
#include "openmmrigidhi/SchemeTraits.h"
#include "openmmrigidhi/internal/Errors.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Boltzmann's constant in kJ/(mol K): 1.380649e-23 J/K times 6.02214076e23/mol, both exact since
 * 2019. */
constexpr double boltzmann = 8.31446261815324e-3;
/**
 * The relative amount by which moments may violate the triangle inequality: rounding of a planar
 * body's moments.
 */
constexpr double triangleTolerance = 1e-9;

constexpr ErrorsOf fail{"CustomRigidHIIntegrator"};

string bodyName(int index) { return "body " + text(index); }

void checkNonNegative(double value, const string& object, const string& quantity,
                      const string& unit) {
    if (!isfinite(value) || value < 0)
        fail(object, quantity + " is " + text(value) + " " + unit,
             "it must be finite and not negative");
}

void checkPositive(double value, const string& object, const string& quantity, const string& unit) {
    if (!isfinite(value) || value <= 0)
        fail(object, quantity + " is " + text(value) + " " + unit,
             "it must be finite and positive");
}

void checkParticleIndex(int particle, const char* method) {
    if (particle < 0)
        fail(method, "the particle's index is " + text(particle), "it must not be negative",
             "give the index of a particle of the System");
}

void checkFinite(const Vec3& value, const string& object, const string& quantity) {
    if (!isfinite(value[0]) || !isfinite(value[1]) || !isfinite(value[2]))
        fail(object,
             quantity + " is (" + text(value[0]) + ", " + text(value[1]) + ", " + text(value[2]) +
                 ")",
             "all three numbers must be finite");
}

void checkMoments(const Vec3& moments, const string& object) {
    const char* axes[] = {"x", "y", "z"};
    for (int k = 0; k < 3; k++)
        checkNonNegative(moments[k], object, string("moment about ") + axes[k], "amu nm^2");
    const double largest = max({moments[0], moments[1], moments[2]});
    const double others = moments[0] + moments[1] + moments[2] - largest;
    if (largest > others * (1 + triangleTolerance))
        fail(object,
             "moments (" + text(moments[0]) + ", " + text(moments[1]) + ", " + text(moments[2]) +
                 ") amu nm^2 violate the triangle inequality",
             "no moment may exceed the sum of the other two, here " + text(others),
             "check the moments and their units, since no distribution of mass has these moments");
}

/**
 * @param bodies  of the Context
 * @param known   to the integrator, which may have more by now
 */
void checkRows(size_t rows, int bodies, int known, const char* method) {
    if (rows == static_cast<size_t>(bodies)) return;
    if (known != bodies)
        fail(method, "got " + text(rows) + " rows",
             "the Context has " + text(bodies) + " bodies, and the integrator " + text(known) +
                 ", because bodies that you add later become part of the next Context only",
             "give one row for each body of the Context, or call reinitialize() on the Context "
             "first");
    fail(method, "got " + text(rows) + " rows",
         "each of the " + text(bodies) + " bodies needs one row");
}

void checkVectors(const vector<Vec3>& rows, int bodies, int known, const char* method,
                  const string& quantity) {
    checkRows(rows.size(), bodies, known, method);
    for (size_t i = 0; i < rows.size(); i++) checkFinite(rows[i], bodyName(i), quantity);
}

}  // namespace

CustomRigidHIIntegrator::CustomRigidHIIntegrator(double temperature, double stepSize)
    : scheme(LangevinC), noiseLaw(Gaussian), wallRejection(Overlap),
      driftCorrectorScaling(SlipOnly), friction(1), rotationalFriction(1), inertiaScale(1),
      gradientTime(0.004), gradientRotationalTime(0.001), poseTolerance(2e-3),
      finiteDifferenceStep(0), jointTolerance(1e-10), randomSeed(0), settingsVersion(0),
      maximumRejections(100), numHostThreads(0), hasKernel(false), contextIsGone(false) {
    setTemperature(temperature);
    setStepSize(stepSize);
    setConstraintTolerance(1e-5);
}

CustomRigidHIIntegrator::~CustomRigidHIIntegrator() {}

// ---- Bodies ----

void CustomRigidHIIntegrator::checkBodyIndex(int index, const char* method) const {
    if (index < 0 || index >= getNumRigidBodies())
        fail(method, "body index " + text(index) + " is out of range",
             "the integrator has " + text(bodies.size()) + " bodies, counted from 0",
             "add the body first, or correct the index");
}

/**
 * Check the particles of a body that will have this index. They replace the present particles of
 * the body, if any.
 */
void CustomRigidHIIntegrator::checkParticles(const vector<int>& particles, int index) const {
    if (particles.empty())
        fail(bodyName(index), "it has no particles", "a body needs at least one",
             "give the indices of its particles");
    unordered_set<int> seen;
    for (int particle : particles) {
        if (particle < 0)
            fail(bodyName(index), "particle index " + text(particle) + " is negative",
                 "particles are counted from 0");
        if (!seen.insert(particle).second)
            fail(bodyName(index), "particle " + text(particle) + " is named twice",
                 "a particle may be in a body only once", "remove the repetition");
        const auto owner = bodyOfParticle.find(particle);
        if (owner != bodyOfParticle.end() && owner->second != index)
            fail(bodyName(index),
                 "particle " + text(particle) + " is already in body " + text(owner->second),
                 "a particle may be in one body only", "remove it from one of them");
    }
}

/** Check mass, moments and sites of a body that has these particles. */
void CustomRigidHIIntegrator::checkGeometry(const vector<int>& particles, double mass,
                                            const Vec3& principalMoments,
                                            const vector<Vec3>& sitePositions, int index) const {
    checkNonNegative(mass, bodyName(index), "mass", "amu");
    checkMoments(principalMoments, bodyName(index));
    if (sitePositions.size() != particles.size())
        fail(bodyName(index),
             "it has " + text(particles.size()) + " particles but " + text(sitePositions.size()) +
                 " site positions",
             "each particle needs one site position");
    for (size_t i = 0; i < sitePositions.size(); i++)
        checkFinite(sitePositions[i], bodyName(index), "site of particle " + text(particles[i]));
}

CustomRigidHIIntegrator::Body CustomRigidHIIntegrator::makeExplicitBody(
    const vector<int>& particles, double mass, const Vec3& principalMoments,
    const vector<Vec3>& sitePositions, int index) const {
    checkParticles(particles, index);
    checkGeometry(particles, mass, principalMoments, sitePositions, index);
    Body body;
    body.particles = particles;
    body.isExplicit = body.geometryIsKnown = true;
    body.mass = mass;
    body.principalMoments = principalMoments;
    body.sitePositions = sitePositions;
    return body;
}

int CustomRigidHIIntegrator::appendBody(const Body& body) {
    const int index = getNumRigidBodies();
    bodies.push_back(body);
    for (int particle : body.particles) bodyOfParticle[particle] = index;
    settingsVersion++;
    return index;
}

int CustomRigidHIIntegrator::addRigidBody(const vector<int>& particles) {
    checkParticles(particles, getNumRigidBodies());
    Body body;
    body.particles = particles;
    return appendBody(body);
}

int CustomRigidHIIntegrator::addRigidBody(const vector<int>& particles, double mass,
                                          const Vec3& principalMoments,
                                          const vector<Vec3>& sitePositions) {
    return appendBody(
        makeExplicitBody(particles, mass, principalMoments, sitePositions, getNumRigidBodies()));
}

int CustomRigidHIIntegrator::getNumRigidBodies() const { return bodies.size(); }

int CustomRigidHIIntegrator::getNumRigidBodiesOfContext() const {
    return boundKernel("getNumRigidBodiesOfContext()").getBodies().getNumBodies();
}

void CustomRigidHIIntegrator::getRigidBodyParameters(int index, vector<int>& particles,
                                                     double& mass, Vec3& principalMoments,
                                                     vector<Vec3>& sitePositions) const {
    checkBodyIndex(index, "getRigidBodyParameters()");
    if (!bodies[index].geometryIsKnown) {
        if (hasKernel) boundKernel("getRigidBodyParameters()").getBodies().requireGeometry();
        // The kernel does not know bodies that were added after Context creation.
        if (!bodies[index].geometryIsKnown)
            fail(bodyName(index), "its mass, moments and sites are not known",
                 "the System and the first positions determine them",
                 "create a Context with this integrator and set positions first");
    }
    const Body& body = bodies[index];
    particles = body.particles;
    mass = body.mass;
    principalMoments = body.principalMoments;
    sitePositions = body.sitePositions;
}

const vector<int>& CustomRigidHIIntegrator::getRigidBodyParticles(int index) const {
    checkBodyIndex(index, "getRigidBodyParticles()");
    return bodies[index].particles;
}

bool CustomRigidHIIntegrator::getRigidBodyIsExplicit(int index) const {
    checkBodyIndex(index, "getRigidBodyIsExplicit()");
    return bodies[index].isExplicit;
}

bool CustomRigidHIIntegrator::getRigidBodyGeometryIsKnown(int index) const {
    checkBodyIndex(index, "getRigidBodyGeometryIsKnown()");
    return bodies[index].geometryIsKnown;
}

void CustomRigidHIIntegrator::setRigidBodyParameters(int index, const vector<int>& particles,
                                                     double mass, const Vec3& principalMoments,
                                                     const vector<Vec3>& sitePositions) {
    checkBodyIndex(index, "setRigidBodyParameters()");
    Body body = makeExplicitBody(particles, mass, principalMoments, sitePositions, index);
    body.hasOwnFriction = bodies[index].hasOwnFriction;
    body.gamma = bodies[index].gamma;
    body.Gamma = bodies[index].Gamma;
    body.held = bodies[index].held;
    for (int particle : bodies[index].particles) bodyOfParticle.erase(particle);
    for (int particle : particles) bodyOfParticle[particle] = index;
    bodies[index] = body;
    settingsVersion++;
}

void CustomRigidHIIntegrator::resetBodyGeometry() {
    for (Body& body : bodies)
        if (!body.isExplicit) {
            body.geometryIsKnown = false;
            body.mass = 0;
            body.principalMoments = Vec3();
            body.sitePositions.clear();
        }
    settingsVersion++;
    if (hasKernel) boundKernel("resetBodyGeometry()").resetBodyGeometry();
}

void CustomRigidHIIntegrator::recordBodyGeometry(int index, double mass,
                                                 const Vec3& principalMoments,
                                                 const vector<Vec3>& sitePositions) const {
    checkBodyIndex(index, "recordBodyGeometry()");
    Body& body = bodies[index];
    checkGeometry(body.particles, mass, principalMoments, sitePositions, index);
    body.geometryIsKnown = true;
    body.mass = mass;
    body.principalMoments = principalMoments;
    body.sitePositions = sitePositions;
}

int CustomRigidHIIntegrator::getSettingsVersion() const { return settingsVersion; }

// ---- Settings ----

CustomRigidHIIntegrator::Scheme CustomRigidHIIntegrator::getScheme() const { return scheme; }

void CustomRigidHIIntegrator::setScheme(Scheme scheme) {
    if (scheme < 0 || scheme >= static_cast<int>(size(schemeTable))) {
        string names;
        for (const SchemeTraits& traits : schemeTable)
            names += (names.empty() ? "" : ", ") + string(traits.name);
        fail("setScheme()", "scheme " + text(static_cast<int>(scheme)) + " is unknown",
             "it must be one of " + names, "use the class constants");
    }
    this->scheme = scheme;
    settingsVersion++;
}

CustomRigidHIIntegrator::NoiseLaw CustomRigidHIIntegrator::getNoiseLaw() const { return noiseLaw; }

void CustomRigidHIIntegrator::setNoiseLaw(NoiseLaw law) {
    if (law < Gaussian || law > TwoPoint)
        fail("setNoiseLaw()", "noise law " + text(static_cast<int>(law)) + " is unknown",
             "it must be one of Gaussian, ThreePoint, TwoPoint", "use the class constants");
    noiseLaw = law;
    settingsVersion++;
}

double CustomRigidHIIntegrator::getTemperature() const { return temperature; }

void CustomRigidHIIntegrator::setTemperature(double temperature) {
    checkNonNegative(temperature, "setTemperature()", "temperature", "K");
    this->temperature = temperature;
    settingsVersion++;
}

double CustomRigidHIIntegrator::getFriction() const { return friction; }

void CustomRigidHIIntegrator::setFriction(double gamma) {
    checkNonNegative(gamma, "setFriction()", "friction gamma", "1/ps");
    friction = gamma;
    settingsVersion++;
}

double CustomRigidHIIntegrator::getRotationalFriction() const { return rotationalFriction; }

void CustomRigidHIIntegrator::setRotationalFriction(double Gamma) {
    checkNonNegative(Gamma, "setRotationalFriction()", "rotational friction Gamma", "1/ps");
    rotationalFriction = Gamma;
    settingsVersion++;
}

double CustomRigidHIIntegrator::getInertiaScale() const { return inertiaScale; }

void CustomRigidHIIntegrator::setInertiaScale(double factor) {
    checkPositive(factor, "setInertiaScale()", "factor of the principal moments", "(relative)");
    inertiaScale = factor;
    settingsVersion++;
}

void CustomRigidHIIntegrator::setBodyFriction(int index, double gamma, double Gamma) {
    checkBodyIndex(index, "setBodyFriction()");
    checkNonNegative(gamma, bodyName(index), "friction gamma", "1/ps");
    checkNonNegative(Gamma, bodyName(index), "rotational friction Gamma", "1/ps");
    bodies[index].hasOwnFriction = true;
    bodies[index].gamma = gamma;
    bodies[index].Gamma = Gamma;
    settingsVersion++;
}

void CustomRigidHIIntegrator::getBodyFriction(int index, double& gamma, double& Gamma) const {
    checkBodyIndex(index, "getBodyFriction()");
    const Body& body = bodies[index];
    gamma = body.hasOwnFriction ? body.gamma : friction;
    Gamma = body.hasOwnFriction ? body.Gamma : rotationalFriction;
}

bool CustomRigidHIIntegrator::getBodyHasOwnFriction(int index) const {
    checkBodyIndex(index, "getBodyHasOwnFriction()");
    return bodies[index].hasOwnFriction;
}

void CustomRigidHIIntegrator::clearBodyFriction(int index) {
    checkBodyIndex(index, "clearBodyFriction()");
    bodies[index].hasOwnFriction = false;
    settingsVersion++;
}

void CustomRigidHIIntegrator::setBodyHeld(int index, bool held) {
    checkBodyIndex(index, "setBodyHeld()");
    bodies[index].held = held;
    settingsVersion++;
}

bool CustomRigidHIIntegrator::getBodyHeld(int index) const {
    checkBodyIndex(index, "getBodyHeld()");
    return bodies[index].held;
}

void CustomRigidHIIntegrator::setParticleHeld(int particle, bool held) {
    checkParticleIndex(particle, "setParticleHeld()");
    if (held)
        heldParticles.insert(particle);
    else
        heldParticles.erase(particle);
    settingsVersion++;
}

bool CustomRigidHIIntegrator::getParticleHeld(int particle) const {
    checkParticleIndex(particle, "getParticleHeld()");
    return heldParticles.count(particle) != 0;
}

vector<int> CustomRigidHIIntegrator::getHeldParticles() const {
    return vector<int>(heldParticles.begin(), heldParticles.end());
}

// ---- Joints ----

namespace {

void checkAxis(const Vec3& axis, const string& object, const string& quantity) {
    checkFinite(axis, object, quantity);
    if (axis == Vec3())
        fail(object, quantity + " is (0, 0, 0)", "an axis needs a direction",
             "give the direction of the hinge in the body frame, with any length but 0");
}

void checkRate(double rate, const char* method) {
    if (!isfinite(rate))
        fail(method, "rate is " + text(rate) + " rad/ps", "it must be finite",
             "give a finite rate of either sign");
}

/**
 * The unit vector along an axis that is finite and not 0, for components of any size. Unit vectors
 * stay as they are, to the last bit, so that copies are the same.
 */
Vec3 direction(Vec3 axis) {
    if (abs(axis.dot(axis) - 1) <= 1e-14) return axis;
    axis /= max({abs(axis[0]), abs(axis[1]), abs(axis[2])});
    return axis / sqrt(axis.dot(axis));
}

}  // namespace

/** Check what joints of all kinds have, and append this joint. @param method  the calling method */
int CustomRigidHIIntegrator::appendJoint(const JointDefinition& joint, const char* method) {
    const bool isToPoint = joint.kind == JointDefinition::BallToPoint;
    checkBodyIndex(joint.i, method);
    if (!isToPoint) checkBodyIndex(joint.j, method);
    if (joint.i == joint.j)
        fail(method, "both bodies are body " + text(joint.i),
             "a joint is between two bodies or between a body and a point",
             "give two bodies, or use addBallJointToPoint() for a place in space");
    checkFinite(joint.anchor_i, method, "anchor in body " + text(joint.i));
    checkFinite(joint.anchor_j, method,
                isToPoint ? "point of space" : "anchor in body " + text(joint.j));
    joints.push_back(joint);
    settingsVersion++;
    return getNumJoints() - 1;
}

int CustomRigidHIIntegrator::addBallJoint(int i, const Vec3& anchor_i, int j,
                                          const Vec3& anchor_j) {
    JointDefinition joint;
    joint.kind = JointDefinition::Ball;
    joint.i = i;
    joint.j = j;
    joint.anchor_i = anchor_i;
    joint.anchor_j = anchor_j;
    return appendJoint(joint, "addBallJoint()");
}

int CustomRigidHIIntegrator::addBallJointToPoint(int i, const Vec3& anchor_i, const Vec3& point) {
    JointDefinition joint;
    joint.kind = JointDefinition::BallToPoint;
    joint.i = i;
    joint.anchor_i = anchor_i;
    joint.anchor_j = point;
    return appendJoint(joint, "addBallJointToPoint()");
}

int CustomRigidHIIntegrator::addLink(int i, const Vec3& anchor_i, int j, const Vec3& anchor_j,
                                     double length) {
    if (!isfinite(length) || length <= 0)
        fail("addLink()", "length is " + text(length) + " nm", "it must be finite and positive",
             "give a value above 0, or use addBallJoint() for a length of 0");
    JointDefinition joint;
    joint.kind = JointDefinition::Link;
    joint.i = i;
    joint.j = j;
    joint.anchor_i = anchor_i;
    joint.anchor_j = anchor_j;
    joint.length = length;
    return appendJoint(joint, "addLink()");
}

int CustomRigidHIIntegrator::addHinge(int i, const Vec3& anchor_i, int j, const Vec3& anchor_j,
                                      const Vec3& axis_i, const Vec3& axis_j) {
    checkAxis(axis_i, "addHinge()", "axis in body " + text(i));
    checkAxis(axis_j, "addHinge()", "axis in body " + text(j));
    JointDefinition joint;
    joint.kind = JointDefinition::Hinge;
    joint.i = i;
    joint.j = j;
    joint.anchor_i = anchor_i;
    joint.anchor_j = anchor_j;
    joint.axis_i = direction(axis_i);
    joint.axis_j = direction(axis_j);
    return appendJoint(joint, "addHinge()");
}

int CustomRigidHIIntegrator::addJoint(const JointDefinition& joint) {
    if (joint.kind == JointDefinition::BallToPoint)
        return addBallJointToPoint(joint.i, joint.anchor_i, joint.anchor_j);
    if (joint.kind == JointDefinition::Link)
        return addLink(joint.i, joint.anchor_i, joint.j, joint.anchor_j, joint.length);
    if (joint.kind == JointDefinition::Hinge)
        return addHinge(joint.i, joint.anchor_i, joint.j, joint.anchor_j, joint.axis_i,
                        joint.axis_j);
    return addBallJoint(joint.i, joint.anchor_i, joint.j, joint.anchor_j);
}

int CustomRigidHIIntegrator::getNumJoints() const { return joints.size(); }

const JointDefinition& CustomRigidHIIntegrator::getJointParameters(int index) const {
    if (index < 0 || index >= getNumJoints())
        fail("getJointParameters()", "joint index " + text(index) + " is out of range",
             "the integrator has " + text(joints.size()) + " joints, counted from 0",
             "add the joint first, or correct the index");
    return joints[index];
}

const vector<JointDefinition>& CustomRigidHIIntegrator::getJoints() const { return joints; }

int CustomRigidHIIntegrator::addHingeMotor(int hinge, double rate) {
    const char* const method = "addHingeMotor()";
    if (hinge < 0 || hinge >= getNumJoints())
        fail(method, "joint index " + text(hinge) + " is out of range",
             "the integrator has " + text(joints.size()) + " joints, counted from 0",
             "add the hinge first, or correct the index");
    const string name = jointText(hinge, joints[hinge]);
    if (joints[hinge].kind != JointDefinition::Hinge)
        fail(method, name + " is no hinge", "a motor turns bodies about the axis of a hinge",
             "give an index that addHinge() returned");
    for (size_t m = 0; m < motors.size(); m++)
        if (motors[m].hinge == hinge)
            fail(method, name + " has motor " + text(m) + " already", "a hinge has one motor",
                 "change its rate by setHingeMotorRate()");
    checkRate(rate, method);
    motors.push_back({hinge, rate});
    settingsVersion++;
    return getNumHingeMotors() - 1;
}

int CustomRigidHIIntegrator::getNumHingeMotors() const { return motors.size(); }

void CustomRigidHIIntegrator::checkMotorIndex(int index, const char* method) const {
    if (index < 0 || index >= getNumHingeMotors())
        fail(method, "motor index " + text(index) + " is out of range",
             "the integrator has " + text(motors.size()) + " motors, counted from 0",
             "add the motor first, or correct the index");
}

void CustomRigidHIIntegrator::getHingeMotorParameters(int index, int& hinge, double& rate) const {
    checkMotorIndex(index, "getHingeMotorParameters()");
    hinge = motors[index].hinge;
    rate = motors[index].rate;
}

double CustomRigidHIIntegrator::getHingeMotorRate(int index) const {
    checkMotorIndex(index, "getHingeMotorRate()");
    return motors[index].rate;
}

void CustomRigidHIIntegrator::setHingeMotorRate(int index, double rate) {
    checkMotorIndex(index, "setHingeMotorRate()");
    checkRate(rate, "setHingeMotorRate()");
    motors[index].rate = rate;
    settingsVersion++;
}

const vector<HingeMotorDefinition>& CustomRigidHIIntegrator::getHingeMotors() const {
    return motors;
}

double CustomRigidHIIntegrator::getJointTolerance() const { return jointTolerance; }

void CustomRigidHIIntegrator::setJointTolerance(double tolerance) {
    checkPositive(tolerance, "setJointTolerance()", "joint tolerance", "nm");
    jointTolerance = tolerance;
    settingsVersion++;
}

// ---- Further settings ----

double CustomRigidHIIntegrator::getGradientRelaxationTime() const { return gradientTime; }

void CustomRigidHIIntegrator::setGradientRelaxationTime(double upsilon) {
    checkPositive(upsilon, "setGradientRelaxationTime()", "relaxation time upsilon", "ps");
    gradientTime = upsilon;
    settingsVersion++;
}

double CustomRigidHIIntegrator::getGradientRotationalRelaxationTime() const {
    return gradientRotationalTime;
}

void CustomRigidHIIntegrator::setGradientRotationalRelaxationTime(double Upsilon) {
    checkPositive(Upsilon, "setGradientRotationalRelaxationTime()",
                  "rotational relaxation time Upsilon", "ps");
    gradientRotationalTime = Upsilon;
    settingsVersion++;
}

int CustomRigidHIIntegrator::getRandomNumberSeed() const {
    return hasKernel ? boundKernel("getRandomNumberSeed()").getRandomNumberSeed() : randomSeed;
}

int CustomRigidHIIntegrator::getRandomNumberSeedAsSet() const { return randomSeed; }

void CustomRigidHIIntegrator::setRandomNumberSeed(int seed) {
    randomSeed = seed;
    if (hasKernel) boundKernel("setRandomNumberSeed()").setRandomNumberSeed(seed);
    settingsVersion++;
}

double CustomRigidHIIntegrator::getPoseTolerance() const { return poseTolerance; }

void CustomRigidHIIntegrator::setPoseTolerance(double tolerance) {
    checkPositive(tolerance, "setPoseTolerance()", "pose tolerance", "nm");
    poseTolerance = tolerance;
    settingsVersion++;
}

int CustomRigidHIIntegrator::getNumHostThreads() const { return numHostThreads; }

void CustomRigidHIIntegrator::setNumHostThreads(int number) {
    const int most = 1024;
    if (number < 0 || number > most)
        fail("setNumHostThreads()", "the number is " + text(number),
             "it must be from 0 to " + text(most),
             "give the number of processors that this Context may use, or 0 for OpenMM's default");
    numHostThreads = number;
    settingsVersion++;
}

double CustomRigidHIIntegrator::getFiniteDifferenceStep() const { return finiteDifferenceStep; }

void CustomRigidHIIntegrator::setFiniteDifferenceStep(double relative) {
    checkNonNegative(relative, "setFiniteDifferenceStep()", "relative step", "body lengths");
    const double largest = 0.1;
    if (relative > largest)
        fail(
            "setFiniteDifferenceStep()", "the relative step is " + text(relative),
            "it must not be above " + text(largest),
            "give 1e-5, which suits most systems, or 0, with which the solver determines the step");
    finiteDifferenceStep = relative;
    settingsVersion++;
}

CustomRigidHIIntegrator::WallRejection CustomRigidHIIntegrator::getWallRejection() const {
    return wallRejection;
}

void CustomRigidHIIntegrator::setWallRejection(WallRejection rejection) {
    if (rejection < Overlap || rejection > Crossing)
        fail("setWallRejection()",
             "wall rejection " + text(static_cast<int>(rejection)) + " is unknown",
             "it must be one of Overlap, Crossing", "use the class constants");
    wallRejection = rejection;
    settingsVersion++;
}

CustomRigidHIIntegrator::DriftCorrectorScaling CustomRigidHIIntegrator::getDriftCorrectorScaling()
    const {
    return driftCorrectorScaling;
}

void CustomRigidHIIntegrator::setDriftCorrectorScaling(DriftCorrectorScaling scaling) {
    if (scaling < SlipOnly || scaling > Whole)
        fail("setDriftCorrectorScaling()",
             "scaling " + text(static_cast<int>(scaling)) + " is unknown",
             "it must be one of SlipOnly, Whole", "use the class constants");
    driftCorrectorScaling = scaling;
    settingsVersion++;
}

int CustomRigidHIIntegrator::getMaximumRejections() const { return maximumRejections; }

void CustomRigidHIIntegrator::setMaximumRejections(int number) {
    // Random numbers depend on the attempt through 16 bits of their counter
    // (platforms/common/random/CounterNoise.h).
    const int most = 65535;
    if (number < 0 || number > most)
        fail("setMaximumRejections()", "the number is " + text(number),
             "it must be from 0 to " + text(most) +
                 ", since no further attempts at a step have random numbers of their own",
             "give a value in this range, and take a smaller step if the scheme redoes steps so "
             "often");
    maximumRejections = number;
    settingsVersion++;
}

int CustomRigidHIIntegrator::getNumRejectedSteps() const {
    return boundKernel("getNumRejectedSteps()").getBodies().getNumRejectedSteps();
}

void CustomRigidHIIntegrator::setStepSize(double size) {
    checkPositive(size, "setStepSize()", "step size", "ps");
    Integrator::setStepSize(size);
    settingsVersion++;
}

void CustomRigidHIIntegrator::setConstraintTolerance(double tolerance) {
    checkPositive(tolerance, "setConstraintTolerance()", "constraint tolerance", "(relative)");
    Integrator::setConstraintTolerance(tolerance);
    settingsVersion++;
}

// ---- The state of the bodies of the bound Context ----

void CustomRigidHIIntegrator::requireContext(const char* method) const {
    if (hasKernel) return;
    throw OpenMMException(
        string("CustomRigidHIIntegrator: ") + method + " needs a Context" +
        (contextIsGone ? ", and the Context of this integrator was deleted (Python deletes a "
                         "Context that no variable refers to): keep the Context in a variable"
                       : ": create one with this integrator first"));
}

IntegrateRigidBodiesKernel& CustomRigidHIIntegrator::boundKernel(const char* method) const {
    requireContext(method);
    // Methods that look at the bodies first bring them up to date. This update changes the kernel,
    // but nothing that the user can see.
    return const_cast<Kernel&>(kernel).getAs<IntegrateRigidBodiesKernel>();
}

IntegrateRigidBodiesKernel& CustomRigidHIIntegrator::getKernelForForces(const char* method) const {
    return boundKernel(method);
}

vector<Vec3> CustomRigidHIIntegrator::getBodyPositions() const {
    return boundKernel("getBodyPositions()").getBodies().getBodyPositions();
}

vector<QuaternionArray> CustomRigidHIIntegrator::getBodyOrientations() const {
    return boundKernel("getBodyOrientations()").getBodies().getBodyOrientations();
}

vector<Vec3> CustomRigidHIIntegrator::getBodyVelocities() const {
    return boundKernel("getBodyVelocities()").getBodies().getBodyVelocities();
}

vector<Vec3> CustomRigidHIIntegrator::getBodyAngularVelocities() const {
    return boundKernel("getBodyAngularVelocities()").getBodies().getBodyAngularVelocities();
}

void CustomRigidHIIntegrator::setBodyPositions(const vector<Vec3>& positions) {
    BodiesInContext& bound = boundKernel("setBodyPositions()").getBodies();
    checkVectors(positions, bound.getNumBodies(), getNumRigidBodies(), "setBodyPositions()",
                 "position");
    bound.setBodyPositions(positions);
}

void CustomRigidHIIntegrator::setBodyOrientations(const vector<QuaternionArray>& orientations) {
    constexpr double lengthTolerance = 1e-3;
    BodiesInContext& bound = boundKernel("setBodyOrientations()").getBodies();
    checkRows(orientations.size(), bound.getNumBodies(), getNumRigidBodies(),
              "setBodyOrientations()");
    vector<QuaternionArray> unit(orientations);
    for (size_t i = 0; i < unit.size(); i++) {
        QuaternionArray& q = unit[i];
        const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        // This form of the comparison also fails for NaN.
        if (!(abs(length - 1) <= lengthTolerance))
            fail(bodyName(i), "its quaternion has length " + text(length),
                 "the length must be 1 within " + text(lengthTolerance),
                 "normalise it, in the order (w, x, y, z)");
        for (double& component : q) component /= length;
    }
    bound.setBodyOrientations(unit);
}

void CustomRigidHIIntegrator::setBodyVelocities(const vector<Vec3>& velocities) {
    BodiesInContext& bound = boundKernel("setBodyVelocities()").getBodies();
    checkVectors(velocities, bound.getNumBodies(), getNumRigidBodies(), "setBodyVelocities()",
                 "velocity");
    bound.setBodyVelocities(velocities);
}

void CustomRigidHIIntegrator::setBodyAngularVelocities(const vector<Vec3>& angularVelocities) {
    BodiesInContext& bound = boundKernel("setBodyAngularVelocities()").getBodies();
    checkVectors(angularVelocities, bound.getNumBodies(), getNumRigidBodies(),
                 "setBodyAngularVelocities()", "angular velocity");
    bound.setBodyAngularVelocities(angularVelocities);
}

vector<Vec3> CustomRigidHIIntegrator::getBodyForces() const {
    return boundKernel("getBodyForces()").getBodies().getBodyForces();
}

vector<Vec3> CustomRigidHIIntegrator::getBodyTorques() const {
    return boundKernel("getBodyTorques()").getBodies().getBodyTorques();
}

vector<double> CustomRigidHIIntegrator::computeHoldingWrenches() const {
    return boundKernel("computeHoldingWrenches()").getBodies().computeHoldingWrenches();
}

vector<double> CustomRigidHIIntegrator::getHoldingWrenches() const {
    return boundKernel("getHoldingWrenches()").getBodies().getHoldingWrenches();
}

vector<Vec3> CustomRigidHIIntegrator::computeParticleHoldingForces() const {
    return boundKernel("computeParticleHoldingForces()").getBodies().computeParticleHoldingForces();
}

vector<Vec3> CustomRigidHIIntegrator::getParticleHoldingForces() const {
    return boundKernel("getParticleHoldingForces()").getBodies().getParticleHoldingForces();
}

vector<Vec3> CustomRigidHIIntegrator::getJointForces() const {
    return boundKernel("getJointForces()").getBodies().getJointForces();
}

vector<double> CustomRigidHIIntegrator::getHingeMotorTorques() const {
    return boundKernel("getHingeMotorTorques()").getBodies().getHingeMotorTorques();
}

double CustomRigidHIIntegrator::getPoseResidual() const {
    return boundKernel("getPoseResidual()").getBodies().getPoseResidual();
}

// ---- Energies and temperature ----

double CustomRigidHIIntegrator::computeTranslationalKineticEnergy() const {
    return boundKernel("computeTranslationalKineticEnergy()")
        .getBodies()
        .computeTranslationalKineticEnergy();
}

Vec3 CustomRigidHIIntegrator::computeRotationalKineticEnergies() const {
    return boundKernel("computeRotationalKineticEnergies()")
        .getBodies()
        .computeRotationalKineticEnergies();
}

double CustomRigidHIIntegrator::computeFreeParticleKineticEnergy() const {
    return boundKernel("computeFreeParticleKineticEnergy()")
        .getBodies()
        .computeFreeParticleKineticEnergy();
}

map<string, int> CustomRigidHIIntegrator::getDegreesOfFreedom() const {
    return boundKernel("getDegreesOfFreedom()").getBodies().getDegreesOfFreedom();
}

double CustomRigidHIIntegrator::computeKineticEnergy() {
    const Vec3 rotational = computeRotationalKineticEnergies();
    return computeTranslationalKineticEnergy() + rotational[0] + rotational[1] + rotational[2] +
           computeFreeParticleKineticEnergy();
}

int CustomRigidHIIntegrator::requireDegreesOfFreedom(const char* method) const {
    requireContext(method);
    if (!traitsOf(scheme).hasMomenta)
        fail(method, "the scheme has no momenta", "a temperature needs momenta",
             "use a Langevin scheme, or report n/a as openmmrigidhi.app.StateDataReporter does");
    const int degrees = getDegreesOfFreedom()["total"];
    if (degrees <= 0)
        fail(method, "the Context has " + text(degrees) + " degrees of freedom",
             "a temperature needs at least one", "give some bodies or free particles a mass");
    return degrees;
}

double CustomRigidHIIntegrator::computeSystemTemperature() {
    const int degrees = requireDegreesOfFreedom("computeSystemTemperature()");
    return 2 * computeKineticEnergy() / (boltzmann * degrees);
}

double CustomRigidHIIntegrator::computeMidStepTemperature() const {
    requireDegreesOfFreedom("computeMidStepTemperature()");
    return boundKernel("computeMidStepTemperature()")
        .getBodies()
        .computeMidStepTemperatures()
        .at("total");
}

map<string, double> CustomRigidHIIntegrator::computeMidStepTemperatures() const {
    requireDegreesOfFreedom("computeMidStepTemperatures()");
    return boundKernel("computeMidStepTemperatures()").getBodies().computeMidStepTemperatures();
}

// ---- What the scene costs ----

namespace {

/** The order in which describeEffects() names effects; the others follow. */
const char* const orderOfEffects[] = {"scheme",
                                      "momenta",
                                      "noise",
                                      "translational friction",
                                      "rotational friction",
                                      "inertia scale",
                                      "bodies",
                                      "rotation",
                                      "slowed spins",
                                      "elongated bodies",
                                      "held bodies",
                                      "prescribed motion",
                                      "joints",
                                      "body forces",
                                      "free particles",
                                      "constraints of free particles",
                                      "hydrodynamics",
                                      "hydrodynamic interactions",
                                      "driven flow",
                                      "active slip",
                                      "forces on the fluid",
                                      "stochastic drift",
                                      "finite differences",
                                      "mobilities asked for",
                                      "barostat",
                                      "centre-of-mass motion removal"};

/** Make a sentence of a text: begin with a capital letter and end with a full stop. */
string sentence(string text) {
    if (!text.empty()) text[0] = toupper(static_cast<unsigned char>(text[0]));
    return text.empty() || text.back() == '.' ? text : text + ".";
}

}  // namespace

string CustomRigidHIIntegrator::describeEffects() const {
    BodiesInContext& bound = boundKernel("describeEffects()").getBodies();
    map<string, string> effects = bound.getEffects();
    effects.erase("warnings");
    const string advice = effects["advice"];  // "on: text", or nothing
    effects.erase("advice");
    string on = "on:\n", off;
    const auto name = [&](const string& effect) {
        const auto found = effects.find(effect);
        if (found == effects.end()) return;
        const string& value = found->second;  // "on: why" or "off: why"
        const size_t colon = value.find(':');
        if (value.compare(0, colon, "on") == 0)
            on += "  " + effect + value.substr(colon) + "\n";
        else
            off += (off.empty() ? "" : ", ") + effect;
        effects.erase(found);
    };
    for (const char* effect : orderOfEffects) name(effect);
    while (!effects.empty()) name(string(effects.begin()->first));
    const vector<string> warnings = bound.getWarnings();
    string last = warnings.empty() ? "warnings: none\n" : "warnings:\n";
    for (const string& warning : warnings) last += "  " + sentence(warning) + "\n";
    return on + (off.empty() ? "" : "off (getEffects() says why): " + off + "\n") +
           (advice.empty() ? "" : "advice:\n  " + sentence(advice.substr(4)) + "\n") + last;
}

map<string, string> CustomRigidHIIntegrator::getEffects() const {
    return boundKernel("getEffects()").getBodies().getEffects();
}

map<string, double> CustomRigidHIIntegrator::getStepStatistics() const {
    return boundKernel("getStepStatistics()").getBodies().getStepStatistics();
}

// ---- What OpenMM calls ----

void CustomRigidHIIntegrator::initialize(ContextImpl& contextImpl) {
    if (hasKernel)
        fail("initialize()", "this integrator is already bound to a context",
             "an integrator can serve one Context at a time", "make a copy for the other Context");
    // A CompoundIntegrator does not tell its integrators when the Context is deleted.
    if (&contextImpl.getIntegrator() != this)
        fail("initialize()", "this integrator is part of another integrator",
             "it must be the Context's own integrator", "do not put it into a CompoundIntegrator");
    // From here on ~Integrator must notify this ContextImpl, whether initialisation succeeds or
    // not. After a failed reinitialize() the ContextImpl lives on, and after a failed creation
    // OpenMM does not delete it.
    context = &contextImpl;
    owner = &contextImpl.getOwner();
    kernel =
        contextImpl.getPlatform().createKernel(IntegrateRigidBodiesKernel::Name(), contextImpl);
    hasKernel = true;
    try {
        kernel.getAs<IntegrateRigidBodiesKernel>().initialize(contextImpl, *this);
    } catch (...) {
        cleanup();
        contextIsGone = false;
        throw;
    }
}

void CustomRigidHIIntegrator::cleanup() {
    kernel = Kernel();
    contextIsGone = contextIsGone || hasKernel;
    hasKernel = false;
}

vector<string> CustomRigidHIIntegrator::getKernelNames() {
    const vector<string> names = {IntegrateRigidBodiesKernel::Name()};
    // OpenMM's own message names neither the library nor the reason.
    bool anyPlatform = false;
    for (int i = 0; i < Platform::getNumPlatforms(); i++)
        anyPlatform = anyPlatform || Platform::getPlatform(i).supportsKernels(names);
    if (!anyPlatform) {
        string failures;
        for (const string& failure : Platform::getPluginLoadFailures())
            failures += "\n  " + failure;
        fail("getKernelNames()", "no platform has the kernels of this integrator",
             "libOpenMMRigidHIReference.so, libOpenMMRigidHICPU.so and libOpenMMRigidHIAny.so must "
             "be loaded",
             "call Platform::loadPluginsFromDirectory() with their directory (in Python, importing "
             "openmmrigidhi does so)." +
                 (failures.empty() ? string(" OpenMM reports no plugin that failed to load.")
                                   : " OpenMM reports plugins that failed to load:" + failures));
    }
    return names;
}

void CustomRigidHIIntegrator::stateChanged(State::DataType changed) {
    if (hasKernel) boundKernel("stateChanged()").stateChanged(changed);
}

vector<Vec3> CustomRigidHIIntegrator::getVelocitiesForTemperature(const System& system,
                                                                  double temperature,
                                                                  int randomSeed) const {
    IntegrateRigidBodiesKernel& bound = boundKernel("setVelocitiesToTemperature()");
    checkNonNegative(temperature, "setVelocitiesToTemperature()", "temperature", "K");
    return bound.drawVelocities(temperature, randomSeed);
}

void CustomRigidHIIntegrator::createCheckpoint(ostream& stream) const {
    boundKernel("createCheckpoint()").createCheckpoint(stream);
}

void CustomRigidHIIntegrator::loadCheckpoint(istream& stream) {
    boundKernel("loadCheckpoint()").loadCheckpoint(stream);
}

void CustomRigidHIIntegrator::serializeParameters(SerializationNode& node) const {
    boundKernel("getState()").serialize(node);
}

void CustomRigidHIIntegrator::deserializeParameters(const SerializationNode& node) {
    boundKernel("setState()").deserialize(node);
}

void CustomRigidHIIntegrator::step(int steps) {
    IntegrateRigidBodiesKernel& bound = boundKernel("step()");
    if (steps < 0)
        fail("step()", "the number of steps is " + text(steps), "it must not be negative");
    bound.step(steps);
}

}  // namespace RigidHIPlugin
