#ifndef OPENMMRIGIDHI_BODY_EXPRESSIONS_NODES_H_
#define OPENMMRIGIDHI_BODY_EXPRESSIONS_NODES_H_

#include <openmm/Force.h>
#include <openmm/serialization/SerializationNode.h>

#include <string>
#include <vector>

#include "openmmrigidhi/internal/BodyExpressions.h"
#include "openmmrigidhi/internal/StrictNode.h"

namespace RigidHIPlugin {

/** Write the contents of a Force of expressions, except what belongs to its class alone. */
void writeBodyExpressions(OpenMM::SerializationNode& node, const OpenMM::Force& force,
                          const BodyExpressions& expressions);

/**
 * Read parameters and bodies through the setters of a Force, so that a damaged file causes the
 * setters' clear exceptions.
 */
template <class Force>
void readBodyExpressions(const StrictNode& node, Force& force) {
    const char* const className = force.getBodyExpressions().getKind().className;
    force.setForceGroup(node.integer("forceGroup"));
    force.setName(node.text("name"));
    const StrictNode perBody = node.child("PerBodyParameters");
    perBody.checkChildren("count");
    for (const OpenMM::SerializationNode& child : perBody.children())
        force.addPerBodyParameter(StrictNode(child, className).text("name"));
    const StrictNode globals = node.child("GlobalParameters");
    globals.checkChildren("count");
    for (const OpenMM::SerializationNode& child : globals.children()) {
        const StrictNode parameter(child, className);
        force.addGlobalParameter(parameter.text("name"), parameter.number("default"));
    }
    const StrictNode bodies = node.child("Bodies");
    bodies.checkChildren("count");
    for (const OpenMM::SerializationNode& child : bodies.children()) {
        const StrictNode entry(child, className);
        entry.checkChildren("parameters");
        std::vector<double> values;
        for (const OpenMM::SerializationNode& value : entry.children())
            values.push_back(StrictNode(value, className).number("value"));
        force.addBody(entry.integer("index"), values);
    }
}

}  // namespace RigidHIPlugin

#endif
