#include "CustomBodyForceProxy.h"

#include <memory>
#include <string>
#include <vector>

#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/internal/StrictNode.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr int formatVersion = 1;
const char* const className = "CustomBodyForce";

}  // namespace

CustomBodyForceProxy::CustomBodyForceProxy() : SerializationProxy(className) {}

void CustomBodyForceProxy::serialize(const void* object, SerializationNode& node) const {
    const CustomBodyForce& force = *static_cast<const CustomBodyForce*>(object);
    node.setIntProperty("version", formatVersion);
    node.setIntProperty("forceGroup", force.getForceGroup());
    node.setStringProperty("name", force.getName());
    for (const string& component : CustomBodyForce::componentNames())
        node.setStringProperty(component, force.getExpression(component));
    SerializationNode& perBody = node.createChildNode("PerBodyParameters");
    perBody.setIntProperty("count", force.getNumPerBodyParameters());
    for (int i = 0; i < force.getNumPerBodyParameters(); i++)
        perBody.createChildNode("Parameter")
            .setStringProperty("name", force.getPerBodyParameterName(i));
    SerializationNode& globals = node.createChildNode("GlobalParameters");
    globals.setIntProperty("count", force.getNumGlobalParameters());
    for (int i = 0; i < force.getNumGlobalParameters(); i++)
        globals.createChildNode("Parameter")
            .setStringProperty("name", force.getGlobalParameterName(i))
            .setDoubleProperty("default", force.getGlobalParameterDefaultValue(i));
    SerializationNode& bodies = node.createChildNode("Bodies");
    bodies.setIntProperty("count", force.getNumBodies());
    for (int i = 0; i < force.getNumBodies(); i++) {
        int body;
        vector<double> values;
        force.getBodyParameters(i, body, values);
        SerializationNode& entry = bodies.createChildNode("Body");
        entry.setIntProperty("index", body).setIntProperty("parameters", values.size());
        for (double value : values)
            entry.createChildNode("Value").setDoubleProperty("value", value);
    }
}

void* CustomBodyForceProxy::deserialize(const SerializationNode& root) const {
    const StrictNode node(root, className);
    if (node.integer("version") != formatVersion)
        node.wrongValue("version", to_string(formatVersion));
    unique_ptr<CustomBodyForce> force(new CustomBodyForce(node.text("fx"), node.text("fy"),
                                                          node.text("fz"), node.text("tx"),
                                                          node.text("ty"), node.text("tz")));
    force->setForceGroup(node.integer("forceGroup"));
    force->setName(node.text("name"));
    const StrictNode perBody = node.child("PerBodyParameters");
    perBody.checkChildren("count");
    for (const SerializationNode& child : perBody.children())
        force->addPerBodyParameter(StrictNode(child, className).text("name"));
    const StrictNode globals = node.child("GlobalParameters");
    globals.checkChildren("count");
    for (const SerializationNode& child : globals.children()) {
        const StrictNode parameter(child, className);
        force->addGlobalParameter(parameter.text("name"), parameter.number("default"));
    }
    const StrictNode bodies = node.child("Bodies");
    bodies.checkChildren("count");
    for (const SerializationNode& child : bodies.children()) {
        const StrictNode entry(child, className);
        entry.checkChildren("parameters");
        vector<double> values;
        for (const SerializationNode& value : entry.children())
            values.push_back(StrictNode(value, className).number("value"));
        force->addBody(entry.integer("index"), values);
    }
    return force.release();
}

}  // namespace RigidHIPlugin
