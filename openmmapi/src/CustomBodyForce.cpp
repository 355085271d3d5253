#include "openmmrigidhi/CustomBodyForce.h"

#include "openmmrigidhi/internal/CustomBodyForceImpl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

const BodyExpressions::Kind& kind() {
    static const BodyExpressions::Kind kind = {
        "CustomBodyForce",
        {{"fx", "fy", "fz", "tx", "ty", "tz"}},
        {"x", "y", "z", "q0", "q1", "q2", "q3", "vx", "vy", "vz", "t"}};
    return kind;
}

}  // namespace

CustomBodyForceImpl::CustomBodyForceImpl(const CustomBodyForce& owner)
    : BodyExpressionsImpl(owner.getBodyExpressions()), owner(owner) {}

const CustomBodyForce& CustomBodyForceImpl::getOwner() const { return owner; }

CustomBodyForce::CustomBodyForce(const string& fx, const string& fy, const string& fz,
                                 const string& tx, const string& ty, const string& tz)
    : expressions(kind(), {{fx, fy, fz, tx, ty, tz}}) {
    setName("CustomBodyForce");
}

CustomBodyForce::~CustomBodyForce() {}

const string& CustomBodyForce::getExpression(const string& component) const {
    return expressions.getExpression(component);
}

void CustomBodyForce::setExpression(const string& component, const string& expression) {
    expressions.setExpression(component, expression);
}

int CustomBodyForce::getNumPerBodyParameters() const {
    return expressions.getNumPerBodyParameters();
}

int CustomBodyForce::addPerBodyParameter(const string& name) {
    return expressions.addPerBodyParameter(name);
}

const string& CustomBodyForce::getPerBodyParameterName(int index) const {
    return expressions.getPerBodyParameterName(index);
}

void CustomBodyForce::setPerBodyParameterName(int index, const string& name) {
    expressions.setPerBodyParameterName(index, name);
}

int CustomBodyForce::getNumGlobalParameters() const { return expressions.getNumGlobalParameters(); }

int CustomBodyForce::addGlobalParameter(const string& name, double defaultValue) {
    return expressions.addGlobalParameter(name, defaultValue);
}

const string& CustomBodyForce::getGlobalParameterName(int index) const {
    return expressions.getGlobalParameterName(index);
}

void CustomBodyForce::setGlobalParameterName(int index, const string& name) {
    expressions.setGlobalParameterName(index, name);
}

double CustomBodyForce::getGlobalParameterDefaultValue(int index) const {
    return expressions.getGlobalParameterDefaultValue(index);
}

void CustomBodyForce::setGlobalParameterDefaultValue(int index, double defaultValue) {
    expressions.setGlobalParameterDefaultValue(index, defaultValue);
}

int CustomBodyForce::getNumBodies() const { return expressions.getNumBodies(); }

int CustomBodyForce::addBody(int bodyIndex, const vector<double>& parameters) {
    return expressions.addBody(bodyIndex, parameters);
}

void CustomBodyForce::getBodyParameters(int index, int& bodyIndex,
                                        vector<double>& parameters) const {
    expressions.getBodyParameters(index, bodyIndex, parameters);
}

void CustomBodyForce::setBodyParameters(int index, int bodyIndex,
                                        const vector<double>& parameters) {
    expressions.setBodyParameters(index, bodyIndex, parameters);
}

void CustomBodyForce::updateParametersInContext(Context& context) {
    dynamic_cast<CustomBodyForceImpl&>(getImplInContext(context))
        .updateParametersInContext(getContextImpl(context));
}

bool CustomBodyForce::usesPeriodicBoundaryConditions() const { return false; }

ForceImpl* CustomBodyForce::createImpl() const { return new CustomBodyForceImpl(*this); }

}  // namespace RigidHIPlugin
