#include "MobilityForceProxy.h"

#include <memory>
#include <string>
#include <vector>

#include "EnumNames.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

const char* const className = "MobilityForce";
/**
 * The later versions, written only with contents that earlier versions of the library would ignore.
 * For version 2 these are slips of bodies, forces that bodies exert on the fluid, lubrication of
 * models other than StokesianDynamics, and its reach. For version 3 it is shear.
 */
constexpr int versionOfActive = 2, versionOfShear = 3, formatVersion = 3;

template <class Enum, class Row, size_t count>
EnumNames<Enum> namesOf(const Row (&table)[count]) {
    EnumNames<Enum> names;
    for (size_t i = 0; i < count; i++) names[table[i].name] = static_cast<Enum>(i);
    return names;
}
const EnumNames<MobilityForce::Model> models = namesOf<MobilityForce::Model>(modelTable);
const EnumNames<MobilityForce::Boundary> boundaries =
    namesOf<MobilityForce::Boundary>(boundaryTable);
const EnumNames<MobilityForce::SphereWallMobility> sphereWallMobilities = {
    {"FromModel", MobilityForce::FromModel}, {"BestKnown", MobilityForce::BestKnown}};
const EnumNames<MobilityForce::ChannelCondition> channelConditions = {
    {"ZeroPressureGradient", MobilityForce::ZeroPressureGradient},
    {"ZeroFlux", MobilityForce::ZeroFlux}};
const EnumNames<MobilityForce::Solver> solvers = {{"Auto", MobilityForce::Auto},
                                                  {"Dense", MobilityForce::Dense},
                                                  {"MatrixFree", MobilityForce::MatrixFree}};
const EnumNames<MobilityForce::Lubrication> lubrications = {
    {"Auto", MobilityForce::AutoLubrication},
    {"On", MobilityForce::On},
    {"Off", MobilityForce::Off}};

/** The settings that are plain numbers. A new one is a line at the end. */
const struct {
    const char* name;
    double (MobilityForce::*get)() const;
    void (MobilityForce::*set)(double);
    bool isInOldFiles;  // if not, a file without the setting leaves its default
} numbers[] = {
    {"viscosity", &MobilityForce::getViscosity, &MobilityForce::setViscosity, true},
    {"wallHeight", &MobilityForce::getWallHeight, &MobilityForce::setWallHeight, false},
    {"minimumGap", &MobilityForce::getMinimumGap, &MobilityForce::setMinimumGap, true},
    {"solverTolerance", &MobilityForce::getSolverTolerance, &MobilityForce::setSolverTolerance,
     true},
    {"gridSpacing", &MobilityForce::getGridSpacing, &MobilityForce::setGridSpacing, false},
};

void writeVector(SerializationNode& node, const Vec3& vector) {
    node.setDoubleProperty("x", vector[0])
        .setDoubleProperty("y", vector[1])
        .setDoubleProperty("z", vector[2]);
}

Vec3 readVector(const StrictNode& node) {
    return Vec3(node.number("x"), node.number("y"), node.number("z"));
}

void writeSlips(SerializationNode& node, const MobilityForce& force) {
    const vector<int> bodies = force.getBodiesWithSlip();
    node.setIntProperty("count", bodies.size());
    for (int body : bodies) {
        const vector<Vec3> velocities = force.getBodySlip(body);
        SerializationNode& slip = node.createChildNode("Slip");
        slip.setIntProperty("body", body).setIntProperty("count", velocities.size());
        for (const Vec3& velocity : velocities)
            writeVector(slip.createChildNode("Velocity"), velocity);
    }
}

void writeForcesOnFluid(SerializationNode& node, const MobilityForce& force) {
    node.setIntProperty("count", force.getNumBodyForcesOnFluid());
    for (int i = 0; i < force.getNumBodyForcesOnFluid(); i++) {
        int body;
        double radius;
        Vec3 site, onFluid;
        force.getBodyForceOnFluidParameters(i, body, site, radius, onFluid);
        SerializationNode& own = node.createChildNode("ForceOnFluid");
        own.setIntProperty("body", body).setDoubleProperty("radius", radius);
        writeVector(own.createChildNode("Site"), site);
        writeVector(own.createChildNode("Force"), onFluid);
    }
}

void readSlips(const StrictNode& node, MobilityForce& force) {
    node.checkChildren("count");
    for (const SerializationNode& child : node.children()) {
        const StrictNode slip(child, className);
        slip.checkChildren("count");
        vector<Vec3> velocities;
        for (const SerializationNode& row : slip.children())
            velocities.push_back(readVector(StrictNode(row, className)));
        force.setBodySlip(slip.integer("body"), velocities);
    }
}

void readForcesOnFluid(const StrictNode& node, MobilityForce& force) {
    node.checkChildren("count");
    for (const SerializationNode& child : node.children()) {
        const StrictNode own(child, className);
        force.addBodyForceOnFluid(own.integer("body"), readVector(own.child("Site")),
                                  own.number("radius"), readVector(own.child("Force")));
    }
}

}  // namespace

MobilityForceProxy::MobilityForceProxy() : SerializationProxy(className) {}

void MobilityForceProxy::serialize(const void* object, SerializationNode& node) const {
    const MobilityForce& force = *static_cast<const MobilityForce*>(object);
    double whole, nothing, rate;
    int flowAxis, gradientAxis;
    force.getLubricationReach(whole, nothing);
    force.getShear(rate, flowAxis, gradientAxis);
    const bool isActive = !force.getBodiesWithSlip().empty() || force.getNumBodyForcesOnFluid() > 0,
               isLubricated = whole > 0 || (force.getLubrication() == MobilityForce::On &&
                                            force.getModel() != MobilityForce::StokesianDynamics),
               isSheared = rate != 0 || flowAxis != 0 || gradientAxis != 1;
    const int version = isSheared ? versionOfShear : isActive || isLubricated ? versionOfActive : 1;
    node.setIntProperty("version", version);
    node.setIntProperty("forceGroup", force.getForceGroup());
    node.setStringProperty("name", force.getName());
    for (const auto& number : numbers) node.setDoubleProperty(number.name, (force.*number.get)());
    node.setStringProperty("model", nameOf(models, force.getModel()));
    node.setStringProperty("boundary", nameOf(boundaries, force.getBoundary()));
    double low, high;
    force.getChannelWalls(low, high);
    node.setDoubleProperty("channelLow", low).setDoubleProperty("channelHigh", high);
    node.setStringProperty("sphereWallMobility",
                           nameOf(sphereWallMobilities, force.getSphereWallMobility()));
    node.setStringProperty("channelCondition",
                           nameOf(channelConditions, force.getChannelCondition()));
    node.setBoolProperty("lubrication", force.getLubrication() != MobilityForce::Off);
    node.setStringProperty("lubricationSetting", nameOf(lubrications, force.getLubrication()));
    node.setDoubleProperty("wholeLubrication", whole).setDoubleProperty("noLubrication", nothing);
    node.setStringProperty("solver", nameOf(solvers, force.getSolver()));
    node.setBoolProperty("fastSummation", force.getFastSummation());
    double f0;
    int forceAxis, waveAxis, index;
    force.getSinusoidalForceDensity(f0, forceAxis, waveAxis, index);
    node.setBoolProperty("flows", true);
    node.createChildNode("SinusoidalForceDensity")
        .setDoubleProperty("f0", f0)
        .setIntProperty("forceAxis", forceAxis)
        .setIntProperty("waveAxis", waveAxis)
        .setIntProperty("waveVectorIndex", index);
    Vec3 velocity;
    vector<double> gradient;
    force.getBackgroundFlow(velocity, gradient);
    SerializationNode& flow = node.createChildNode("BackgroundFlow");
    for (int k = 0; k < 3; k++) flow.setDoubleProperty("v" + to_string(k), velocity[k]);
    for (int k = 0; k < 9; k++) flow.setDoubleProperty("g" + to_string(k), gradient[k]);
    node.setBoolProperty("flowsAlongWalls", true);
    writeVector(node.createChildNode("WallVelocity"), force.getWallVelocity());
    writeVector(node.createChildNode("BodyForceDensity"), force.getBodyForceDensity());
    SerializationNode& particles = node.createChildNode("Particles");
    particles.setIntProperty("count", force.getNumParticles());
    for (int i = 0; i < force.getNumParticles(); i++)
        particles.createChildNode("Particle")
            .setDoubleProperty("radius", force.getParticleRadius(i));
    SerializationNode& tensors = node.createChildNode("OwnMobilities");
    const vector<int> bodies = force.getBodiesWithOwnTensors();
    tensors.setIntProperty("count", bodies.size());
    for (int body : bodies) {
        const bool friction = force.getBodyTensorIsFriction(body);
        SerializationNode& tensor = tensors.createChildNode("Tensor");
        tensor.setIntProperty("body", body).setBoolProperty("friction", friction);
        const vector<double> values =
            friction ? force.getBodyFriction(body) : force.getBodyMobility(body);
        for (int k = 0; k < 36; k++) tensor.setDoubleProperty("v" + to_string(k), values[k]);
    }
    SerializationNode& groups = node.createChildNode("Groups");
    groups.setIntProperty("count", force.getGroups().size());
    for (int group : force.getGroups())
        groups.createChildNode("Group").setIntProperty("group", group);
    if (version == 1) return;
    writeSlips(node.createChildNode("Slips"), force);
    writeForcesOnFluid(node.createChildNode("ForcesOnFluid"), force);
    if (!isSheared) return;
    node.createChildNode("Shear")
        .setDoubleProperty("rate", rate)
        .setIntProperty("flowAxis", flowAxis)
        .setIntProperty("gradientAxis", gradientAxis);
}

void* MobilityForceProxy::deserialize(const SerializationNode& root) const {
    const StrictNode node(root, className);
    const int version = node.integer("version");
    if (version < 1 || version > formatVersion) node.wrongValue("version", "1, 2 or 3");
    auto force = make_unique<MobilityForce>();
    force->setForceGroup(node.integer("forceGroup"));
    force->setName(node.text("name"));
    for (const auto& number : numbers)
        if (number.isInOldFiles || node.has(number.name))
            (force.get()->*number.set)(node.number(number.name));
    force->setModel(valueOf(models, node, "model"));
    force->setBoundary(valueOf(boundaries, node, "boundary"));
    // Older files do not have walls, and have none of the following properties either.
    if (node.has("channelLow") &&
        (node.number("channelLow") != 0 || node.number("channelHigh") != 0))
        force->setChannelWalls(node.number("channelLow"), node.number("channelHigh"));
    if (node.has("sphereWallMobility"))
        force->setSphereWallMobility(valueOf(sphereWallMobilities, node, "sphereWallMobility"));
    if (node.has("channelCondition"))
        force->setChannelCondition(valueOf(channelConditions, node, "channelCondition"));
    // Older files only say whether StokesianDynamics has lubrication, which is its default.
    if (node.has("lubricationSetting")) {
        force->setLubrication(valueOf(lubrications, node, "lubricationSetting"));
        force->setLubricationReach(node.number("wholeLubrication"), node.number("noLubrication"));
    } else if (!node.boolean("lubrication")) {
        force->setLubrication(MobilityForce::Off);
    }
    force->setSolver(valueOf(solvers, node, "solver"));
    if (node.has("fastSummation")) force->setFastSummation(node.boolean("fastSummation"));
    if (node.has("flows")) {
        const StrictNode wave = node.child("SinusoidalForceDensity");
        force->setSinusoidalForceDensity(wave.number("f0"), wave.integer("forceAxis"),
                                         wave.integer("waveAxis"), wave.integer("waveVectorIndex"));
        const StrictNode flow = node.child("BackgroundFlow");
        Vec3 velocity;
        vector<double> gradient;
        for (int k = 0; k < 3; k++) velocity[k] = flow.number("v" + to_string(k));
        for (int k = 0; k < 9; k++) gradient.push_back(flow.number("g" + to_string(k)));
        force->setBackgroundFlow(velocity, gradient);
    }
    if (node.has("flowsAlongWalls")) {
        force->setWallVelocity(readVector(node.child("WallVelocity")));
        force->setBodyForceDensity(readVector(node.child("BodyForceDensity")));
    }
    const StrictNode particles = node.child("Particles");
    particles.checkChildren("count");
    for (const SerializationNode& child : particles.children())
        force->addParticle(StrictNode(child, className).number("radius"));
    const StrictNode tensors = node.child("OwnMobilities");
    tensors.checkChildren("count");
    for (const SerializationNode& child : tensors.children()) {
        const StrictNode tensor(child, className);
        vector<double> values;
        for (int k = 0; k < 36; k++) values.push_back(tensor.number("v" + to_string(k)));
        if (tensor.boolean("friction"))
            force->setBodyFriction(tensor.integer("body"), values);
        else
            force->setBodyMobility(tensor.integer("body"), values);
    }
    const StrictNode list = node.child("Groups");
    list.checkChildren("count");
    vector<int> groups;
    for (const SerializationNode& child : list.children())
        groups.push_back(StrictNode(child, className).integer("group"));
    force->setGroups(groups);
    if (version >= versionOfActive) {
        readSlips(node.child("Slips"), *force);
        readForcesOnFluid(node.child("ForcesOnFluid"), *force);
    }
    if (version >= versionOfShear) {
        const StrictNode shear = node.child("Shear");
        force->setShear(shear.number("rate"), shear.integer("flowAxis"),
                        shear.integer("gradientAxis"));
    }
    return force.release();
}

}  // namespace RigidHIPlugin
