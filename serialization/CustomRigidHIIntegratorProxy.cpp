#include "CustomRigidHIIntegratorProxy.h"

#include <openmm/Vec3.h>

#include <memory>
#include <string>
#include <vector>

#include "EnumNames.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

using Integrator = CustomRigidHIIntegrator;
/**
 * The latest version, written only with contents that earlier versions of the library would ignore:
 * held bodies and particles, joints, and motors.
 */
constexpr int formatVersion = 2;

EnumNames<Integrator::Scheme> namesOfSchemes() {
    EnumNames<Integrator::Scheme> names;
    for (const SchemeTraits& traits : schemeTable) names[traits.name] = traits.scheme;
    return names;
}

const EnumNames<Integrator::Scheme> schemes = namesOfSchemes();
const EnumNames<Integrator::NoiseLaw> noiseLaws = {{"Gaussian", Integrator::Gaussian},
                                                   {"ThreePoint", Integrator::ThreePoint},
                                                   {"TwoPoint", Integrator::TwoPoint}};
const EnumNames<Integrator::WallRejection> wallRejections = {{"Overlap", Integrator::Overlap},
                                                             {"Crossing", Integrator::Crossing}};
const EnumNames<JointDefinition::Kind> jointKinds = [] {
    EnumNames<JointDefinition::Kind> names;
    for (size_t k = 0; k < size(jointKindNames); k++)
        names[jointKindNames[k]] = static_cast<JointDefinition::Kind>(k);
    return names;
}();
const EnumNames<Integrator::DriftCorrectorScaling> driftCorrectorScalings = {
    {"SlipOnly", Integrator::SlipOnly}, {"Whole", Integrator::Whole}};

/** The settings that are plain numbers. A new one is a line at the end. */
const struct {
    const char* name;
    double (Integrator::*get)() const;
    void (Integrator::*set)(double);
    bool isInOldFiles;  // if not, a file without the setting leaves its default
} numbers[] = {
    {"constraintTolerance", &Integrator::getConstraintTolerance,
     &Integrator::setConstraintTolerance, true},
    {"friction", &Integrator::getFriction, &Integrator::setFriction, true},
    {"rotationalFriction", &Integrator::getRotationalFriction, &Integrator::setRotationalFriction,
     true},
    {"gradientRelaxationTime", &Integrator::getGradientRelaxationTime,
     &Integrator::setGradientRelaxationTime, true},
    {"gradientRotationalRelaxationTime", &Integrator::getGradientRotationalRelaxationTime,
     &Integrator::setGradientRotationalRelaxationTime, true},
    {"poseTolerance", &Integrator::getPoseTolerance, &Integrator::setPoseTolerance, true},
    {"inertiaScale", &Integrator::getInertiaScale, &Integrator::setInertiaScale, false},
    {"finiteDifferenceStep", &Integrator::getFiniteDifferenceStep,
     &Integrator::setFiniteDifferenceStep, false},
    {"jointTolerance", &Integrator::getJointTolerance, &Integrator::setJointTolerance, false},
};

void writeVector(SerializationNode& node, const Vec3& vector) {
    node.setDoubleProperty("x", vector[0])
        .setDoubleProperty("y", vector[1])
        .setDoubleProperty("z", vector[2]);
}

Vec3 readVector(const StrictNode& node) {
    return Vec3(node.number("x"), node.number("y"), node.number("z"));
}

bool holdsAnything(const Integrator& integrator) {
    bool held = !integrator.getHeldParticles().empty();
    for (int i = 0; i < integrator.getNumRigidBodies(); i++)
        held = held || integrator.getBodyHeld(i);
    return held;
}

void writeHeldParticles(SerializationNode& node, const Integrator& integrator) {
    const vector<int> particles = integrator.getHeldParticles();
    node.setIntProperty("count", particles.size());
    for (int particle : particles)
        node.createChildNode("Particle").setIntProperty("index", particle);
}

void readHeldParticles(const StrictNode& node, Integrator& integrator) {
    node.checkChildren("count");
    for (const SerializationNode& child : node.children())
        integrator.setParticleHeld(StrictNode(child, "CustomRigidHIIntegrator").integer("index"),
                                   true);
}

void writeJoint(SerializationNode& node, const JointDefinition& joint) {
    node.setStringProperty("kind", nameOf(jointKinds, joint.kind));
    node.setIntProperty("i", joint.i);
    writeVector(node.createChildNode("Anchor_i"), joint.anchor_i);
    if (joint.kind == JointDefinition::BallToPoint) {
        writeVector(node.createChildNode("Point"), joint.anchor_j);
        return;
    }
    node.setIntProperty("j", joint.j);
    writeVector(node.createChildNode("Anchor_j"), joint.anchor_j);
    if (joint.kind == JointDefinition::Link) node.setDoubleProperty("length", joint.length);
    if (joint.kind == JointDefinition::Hinge) {
        writeVector(node.createChildNode("Axis_i"), joint.axis_i);
        writeVector(node.createChildNode("Axis_j"), joint.axis_j);
    }
}

JointDefinition readJoint(const StrictNode& node) {
    JointDefinition joint;
    joint.kind = valueOf(jointKinds, node, "kind");
    const bool isToPoint = joint.kind == JointDefinition::BallToPoint;
    joint.i = node.integer("i");
    joint.anchor_i = readVector(node.child("Anchor_i"));
    joint.anchor_j = readVector(node.child(isToPoint ? "Point" : "Anchor_j"));
    if (!isToPoint) joint.j = node.integer("j");
    if (joint.kind == JointDefinition::Link) joint.length = node.number("length");
    if (joint.kind == JointDefinition::Hinge) {
        joint.axis_i = readVector(node.child("Axis_i"));
        joint.axis_j = readVector(node.child("Axis_j"));
    }
    return joint;
}

/** Write a body: its particles, each with its site if the geometry is known. */
void writeBody(SerializationNode& node, const Integrator& integrator, int index, int version) {
    const bool known = integrator.getRigidBodyGeometryIsKnown(index);
    node.setBoolProperty("explicit", integrator.getRigidBodyIsExplicit(index));
    node.setBoolProperty("geometryIsKnown", known);
    if (integrator.getBodyHasOwnFriction(index)) {
        double gamma, Gamma;
        integrator.getBodyFriction(index, gamma, Gamma);
        node.setDoubleProperty("friction", gamma).setDoubleProperty("rotationalFriction", Gamma);
    }
    if (version >= 2) node.setBoolProperty("held", integrator.getBodyHeld(index));
    vector<int> particles = integrator.getRigidBodyParticles(index);
    vector<Vec3> sites;
    if (known) {
        double mass;
        Vec3 moments;
        integrator.getRigidBodyParameters(index, particles, mass, moments, sites);
        node.setDoubleProperty("mass", mass);
        writeVector(node.createChildNode("PrincipalMoments"), moments);
    }
    SerializationNode& particlesNode = node.createChildNode("Particles");
    particlesNode.setIntProperty("count", particles.size());
    for (size_t i = 0; i < particles.size(); i++) {
        SerializationNode& particle = particlesNode.createChildNode("Particle");
        particle.setIntProperty("index", particles[i]);
        if (known) writeVector(particle, sites[i]);
    }
}

void readBody(const StrictNode& node, Integrator& integrator, int version) {
    const bool isExplicit = node.boolean("explicit");
    const bool known = node.boolean("geometryIsKnown");
    if (isExplicit && !known) node.wrongValue("geometryIsKnown", "1 for an explicit body");
    const StrictNode particlesNode = node.child("Particles");
    particlesNode.checkChildren("count");
    vector<int> particles;
    vector<Vec3> sites;
    for (const SerializationNode& child : particlesNode.children()) {
        const StrictNode particle(child, "CustomRigidHIIntegrator");
        particles.push_back(particle.integer("index"));
        if (known) sites.push_back(readVector(particle));
    }
    double mass = 0;
    Vec3 moments;
    if (known) {
        mass = node.number("mass");
        moments = readVector(node.child("PrincipalMoments"));
    }
    const int index = isExplicit ? integrator.addRigidBody(particles, mass, moments, sites)
                                 : integrator.addRigidBody(particles);
    if (known && !isExplicit) integrator.recordBodyGeometry(index, mass, moments, sites);
    if (node.has("friction") || node.has("rotationalFriction"))
        integrator.setBodyFriction(index, node.number("friction"),
                                   node.number("rotationalFriction"));
    if (version >= 2) integrator.setBodyHeld(index, node.boolean("held"));
}

}  // namespace

CustomRigidHIIntegratorProxy::CustomRigidHIIntegratorProxy()
    : SerializationProxy("CustomRigidHIIntegrator") {}

void CustomRigidHIIntegratorProxy::serialize(const void* object, SerializationNode& node) const {
    const Integrator& integrator = *static_cast<const Integrator*>(object);
    const bool hasJoints = integrator.getNumJoints() > 0;
    const int version = holdsAnything(integrator) || hasJoints ? formatVersion : 1;
    node.setIntProperty("version", version);
    node.setDoubleProperty("stepSize", integrator.getStepSize());
    for (const auto& number : numbers)
        node.setDoubleProperty(number.name, (integrator.*number.get)());
    node.setIntProperty("integrationForceGroups", integrator.getIntegrationForceGroups());
    node.setStringProperty("scheme", nameOf(schemes, integrator.getScheme()));
    node.setStringProperty("noiseLaw", nameOf(noiseLaws, integrator.getNoiseLaw()));
    node.setDoubleProperty("temperature", integrator.getTemperature());
    node.setIntProperty("randomSeed", integrator.getRandomNumberSeedAsSet());
    node.setIntProperty("maximumRejections", integrator.getMaximumRejections());
    node.setIntProperty("numHostThreads", integrator.getNumHostThreads());
    node.setStringProperty("wallRejection", nameOf(wallRejections, integrator.getWallRejection()));
    node.setStringProperty("driftCorrectorScaling",
                           nameOf(driftCorrectorScalings, integrator.getDriftCorrectorScaling()));
    SerializationNode& bodies = node.createChildNode("RigidBodies");
    bodies.setIntProperty("count", integrator.getNumRigidBodies());
    for (int i = 0; i < integrator.getNumRigidBodies(); i++)
        writeBody(bodies.createChildNode("RigidBody"), integrator, i, version);
    if (version >= 2) writeHeldParticles(node.createChildNode("HeldParticles"), integrator);
    if (!hasJoints) return;
    SerializationNode& joints = node.createChildNode("Joints");
    joints.setIntProperty("count", integrator.getNumJoints());
    for (const JointDefinition& joint : integrator.getJoints())
        writeJoint(joints.createChildNode("Joint"), joint);
    if (integrator.getNumHingeMotors() == 0) return;
    SerializationNode& motors = node.createChildNode("HingeMotors");
    motors.setIntProperty("count", integrator.getNumHingeMotors());
    for (const HingeMotorDefinition& motor : integrator.getHingeMotors())
        motors.createChildNode("HingeMotor")
            .setIntProperty("hinge", motor.hinge)
            .setDoubleProperty("rate", motor.rate);
}

void* CustomRigidHIIntegratorProxy::deserialize(const SerializationNode& root) const {
    const StrictNode node(root, "CustomRigidHIIntegrator");
    const int version = node.integer("version");
    if (version < 1 || version > formatVersion)
        node.wrongValue("version", "1 or " + to_string(formatVersion));
    auto integrator = make_unique<Integrator>(node.number("temperature"), node.number("stepSize"));
    for (const auto& number : numbers)
        if (number.isInOldFiles || node.has(number.name))
            (integrator.get()->*number.set)(node.number(number.name));
    integrator->setIntegrationForceGroups(node.integer("integrationForceGroups"));
    integrator->setScheme(valueOf(schemes, node, "scheme"));
    integrator->setNoiseLaw(valueOf(noiseLaws, node, "noiseLaw"));
    integrator->setRandomNumberSeed(node.integer("randomSeed"));
    // Files of version 0.1 have none of the following properties.
    if (node.has("numHostThreads")) integrator->setNumHostThreads(node.integer("numHostThreads"));
    if (node.has("maximumRejections"))
        integrator->setMaximumRejections(node.integer("maximumRejections"));
    if (node.has("wallRejection"))
        integrator->setWallRejection(valueOf(wallRejections, node, "wallRejection"));
    if (node.has("driftCorrectorScaling"))
        integrator->setDriftCorrectorScaling(
            valueOf(driftCorrectorScalings, node, "driftCorrectorScaling"));
    const StrictNode bodies = node.child("RigidBodies");
    bodies.checkChildren("count");
    for (const SerializationNode& body : bodies.children())
        readBody(StrictNode(body, "CustomRigidHIIntegrator"), *integrator, version);
    if (version >= 2) readHeldParticles(node.child("HeldParticles"), *integrator);
    // Only files with joints, or with motors, have these elements.
    const auto forChildren = [&](const char* name, const auto& add) {
        for (const SerializationNode& child : node.children()) {
            if (child.getName() != name) continue;
            const StrictNode list(child, "CustomRigidHIIntegrator");
            list.checkChildren("count");
            for (const SerializationNode& item : list.children())
                add(StrictNode(item, "CustomRigidHIIntegrator"));
        }
    };
    forChildren("Joints", [&](const StrictNode& joint) { integrator->addJoint(readJoint(joint)); });
    forChildren("HingeMotors", [&](const StrictNode& motor) {
        integrator->addHingeMotor(motor.integer("hinge"), motor.number("rate"));
    });
    return integrator.release();
}

}  // namespace RigidHIPlugin
