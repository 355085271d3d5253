#include "CustomBodyForceProxy.h"

#include <memory>
#include <string>

#include "BodyExpressionsNodes.h"
#include "openmmrigidhi/CustomBodyForce.h"

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
    writeBodyExpressions(node, force, force.getBodyExpressions());
}

void* CustomBodyForceProxy::deserialize(const SerializationNode& root) const {
    const StrictNode node(root, className);
    if (node.integer("version") != formatVersion)
        node.wrongValue("version", to_string(formatVersion));
    auto force = make_unique<CustomBodyForce>(node.text("fx"), node.text("fy"), node.text("fz"),
                                              node.text("tx"), node.text("ty"), node.text("tz"));
    readBodyExpressions(node, *force);
    return force.release();
}

}  // namespace RigidHIPlugin
