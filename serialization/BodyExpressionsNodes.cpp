#include "BodyExpressionsNodes.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

void writeBodyExpressions(SerializationNode& node, const Force& force,
                          const BodyExpressions& expressions) {
    node.setIntProperty("forceGroup", force.getForceGroup());
    node.setStringProperty("name", force.getName());
    for (const string& component : expressions.getKind().components)
        node.setStringProperty(component, expressions.getExpression(component));
    SerializationNode& perBody = node.createChildNode("PerBodyParameters");
    perBody.setIntProperty("count", expressions.getNumPerBodyParameters());
    for (int i = 0; i < expressions.getNumPerBodyParameters(); i++)
        perBody.createChildNode("Parameter")
            .setStringProperty("name", expressions.getPerBodyParameterName(i));
    SerializationNode& globals = node.createChildNode("GlobalParameters");
    globals.setIntProperty("count", expressions.getNumGlobalParameters());
    for (int i = 0; i < expressions.getNumGlobalParameters(); i++)
        globals.createChildNode("Parameter")
            .setStringProperty("name", expressions.getGlobalParameterName(i))
            .setDoubleProperty("default", expressions.getGlobalParameterDefaultValue(i));
    SerializationNode& bodies = node.createChildNode("Bodies");
    bodies.setIntProperty("count", expressions.getNumBodies());
    for (int i = 0; i < expressions.getNumBodies(); i++) {
        int body;
        vector<double> values;
        expressions.getBodyParameters(i, body, values);
        SerializationNode& entry = bodies.createChildNode("Body");
        entry.setIntProperty("index", body).setIntProperty("parameters", values.size());
        for (double value : values)
            entry.createChildNode("Value").setDoubleProperty("value", value);
    }
}

}  // namespace RigidHIPlugin
