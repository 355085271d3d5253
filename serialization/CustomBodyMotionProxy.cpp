#include "CustomBodyMotionProxy.h"

#include <memory>
#include <string>

#include "BodyExpressionsNodes.h"
#include "EnumNames.h"
#include "openmmrigidhi/CustomBodyMotion.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr int formatVersion = 1;
const char* const className = "CustomBodyMotion";
const EnumNames<CustomBodyMotion::Frame> frames = {{"Lab", CustomBodyMotion::Lab},
                                                   {"Body", CustomBodyMotion::Body}};

}  // namespace

CustomBodyMotionProxy::CustomBodyMotionProxy() : SerializationProxy(className) {}

void CustomBodyMotionProxy::serialize(const void* object, SerializationNode& node) const {
    const CustomBodyMotion& force = *static_cast<const CustomBodyMotion*>(object);
    node.setIntProperty("version", formatVersion);
    node.setStringProperty("frame", nameOf(frames, force.getFrame()));
    writeBodyExpressions(node, force, force.getBodyExpressions());
}

void* CustomBodyMotionProxy::deserialize(const SerializationNode& root) const {
    const StrictNode node(root, className);
    if (node.integer("version") != formatVersion)
        node.wrongValue("version", to_string(formatVersion));
    auto force = make_unique<CustomBodyMotion>(node.text("vx"), node.text("vy"), node.text("vz"),
                                               node.text("wx"), node.text("wy"), node.text("wz"));
    force->setFrame(valueOf(frames, node, "frame"));
    readBodyExpressions(node, *force);
    return force.release();
}

}  // namespace RigidHIPlugin
