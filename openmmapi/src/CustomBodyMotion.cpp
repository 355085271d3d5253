#include "openmmrigidhi/CustomBodyMotion.h"

#include <openmm/internal/ContextImpl.h>

#include <algorithm>
#include <map>

#include "openmmrigidhi/internal/CustomBodyMotionImpl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr ErrorsOf fail{"CustomBodyMotion"};

const BodyExpressions::Kind& kind() {
    static const BodyExpressions::Kind kind = {
        "CustomBodyMotion", {{"vx", "vy", "vz", "wx", "wy", "wz"}}, {"t"}};
    return kind;
}

}  // namespace

// ---- In a Context ----

CustomBodyMotionImpl::CustomBodyMotionImpl(const CustomBodyMotion& owner)
    : BodyExpressionsImpl(owner.getBodyExpressions()), owner(owner) {}

const CustomBodyMotion& CustomBodyMotionImpl::getOwner() const { return owner; }

void CustomBodyMotionImpl::initialize(ContextImpl& context) {
    BodyExpressionsImpl::initialize(context);
    const auto& components = kind().components;
    if (all_of(components.begin(), components.end(),
               [&](const string& component) { return owner.getExpression(component).empty(); }))
        fail(
            "all six expressions are empty, so that the force prescribes nothing; give at least "
            "one, or remove the force");
    map<int, int> entryOfBody;
    for (int i = 0; i < owner.getNumBodies(); i++) {
        const int body = getBodies()[i];
        const auto added = entryOfBody.insert({body, i});
        if (!added.second)
            fail("entries " + to_string(added.first->second) + " and " + to_string(i) +
                 " are both for body " + to_string(body) +
                 "; a body can have one prescribed motion only: remove one of them");
    }
}

// ---- The force ----

CustomBodyMotion::CustomBodyMotion(const string& vx, const string& vy, const string& vz,
                                   const string& wx, const string& wy, const string& wz)
    : frame(Lab), expressions(kind(), {{vx, vy, vz, wx, wy, wz}}) {
    setName("CustomBodyMotion");
}

CustomBodyMotion::~CustomBodyMotion() {}

CustomBodyMotion::Frame CustomBodyMotion::getFrame() const { return frame; }

void CustomBodyMotion::setFrame(Frame frame) {
    if (frame < Lab || frame > Body)
        fail("setFrame()", "frame " + to_string(static_cast<int>(frame)) + " is unknown",
             "it must be one of Lab, Body", "use the class constants");
    this->frame = frame;
}

const string& CustomBodyMotion::getExpression(const string& component) const {
    return expressions.getExpression(component);
}

void CustomBodyMotion::setExpression(const string& component, const string& expression) {
    expressions.setExpression(component, expression);
}

int CustomBodyMotion::getNumPerBodyParameters() const {
    return expressions.getNumPerBodyParameters();
}

int CustomBodyMotion::addPerBodyParameter(const string& name) {
    return expressions.addPerBodyParameter(name);
}

const string& CustomBodyMotion::getPerBodyParameterName(int index) const {
    return expressions.getPerBodyParameterName(index);
}

void CustomBodyMotion::setPerBodyParameterName(int index, const string& name) {
    expressions.setPerBodyParameterName(index, name);
}

int CustomBodyMotion::getNumGlobalParameters() const {
    return expressions.getNumGlobalParameters();
}

int CustomBodyMotion::addGlobalParameter(const string& name, double defaultValue) {
    return expressions.addGlobalParameter(name, defaultValue);
}

const string& CustomBodyMotion::getGlobalParameterName(int index) const {
    return expressions.getGlobalParameterName(index);
}

void CustomBodyMotion::setGlobalParameterName(int index, const string& name) {
    expressions.setGlobalParameterName(index, name);
}

double CustomBodyMotion::getGlobalParameterDefaultValue(int index) const {
    return expressions.getGlobalParameterDefaultValue(index);
}

void CustomBodyMotion::setGlobalParameterDefaultValue(int index, double defaultValue) {
    expressions.setGlobalParameterDefaultValue(index, defaultValue);
}

int CustomBodyMotion::getNumBodies() const { return expressions.getNumBodies(); }

int CustomBodyMotion::addBody(int bodyIndex, const vector<double>& parameters) {
    return expressions.addBody(bodyIndex, parameters);
}

void CustomBodyMotion::getBodyParameters(int index, int& bodyIndex,
                                         vector<double>& parameters) const {
    expressions.getBodyParameters(index, bodyIndex, parameters);
}

void CustomBodyMotion::setBodyParameters(int index, int bodyIndex,
                                         const vector<double>& parameters) {
    expressions.setBodyParameters(index, bodyIndex, parameters);
}

void CustomBodyMotion::updateParametersInContext(Context& context) {
    dynamic_cast<CustomBodyMotionImpl&>(getImplInContext(context))
        .updateParametersInContext(getContextImpl(context));
}

bool CustomBodyMotion::usesPeriodicBoundaryConditions() const { return false; }

ForceImpl* CustomBodyMotion::createImpl() const { return new CustomBodyMotionImpl(*this); }

}  // namespace RigidHIPlugin
