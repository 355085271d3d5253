#include "openmmrigidhi/CustomBodyForce.h"

#include <algorithm>
#include <cmath>

#include "openmmrigidhi/internal/CustomBodyForceImpl.h"
#include "openmmrigidhi/internal/Errors.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr ErrorsOf fail{"CustomBodyForce"};

void checkIndex(int index, size_t count, const char* method, const string& what) {
    if (index < 0 || index >= (int)count)
        fail(method, "there is no index " + to_string(index),
             "this force has " + to_string(count) + " " + what + ", numbered from 0",
             "add what is missing first, or give another index");
}

void checkFinite(double value, const string& object, const string& quantity) {
    if (isfinite(value)) return;
    fail(object, quantity + " is " + number(value), "parameters must be finite",
         "give a finite value");
}

int componentIndex(const string& component, const char* method) {
    const auto& names = CustomBodyForce::componentNames();
    const auto found = find(names.begin(), names.end(), component);
    if (found == names.end())
        fail(method, "component '" + component + "' is unknown",
             "it must be one of fx, fy, fz, tx, ty, tz", "name one of these");
    return found - names.begin();
}

}  // namespace

const array<string, 6>& CustomBodyForce::componentNames() {
    static const array<string, 6> names = {{"fx", "fy", "fz", "tx", "ty", "tz"}};
    return names;
}

const vector<string>& CustomBodyForce::variableNames() {
    static const vector<string> names = {"x",  "y",  "z",  "q0", "q1", "q2",
                                         "q3", "vx", "vy", "vz", "t"};
    return names;
}

CustomBodyForce::CustomBodyForce(const string& fx, const string& fy, const string& fz,
                                 const string& tx, const string& ty, const string& tz)
    : expressions{{fx, fy, fz, tx, ty, tz}} {
    setName("CustomBodyForce");
}

CustomBodyForce::~CustomBodyForce() {}

const string& CustomBodyForce::getExpression(const string& component) const {
    return expressions[componentIndex(component, "getExpression()")];
}

void CustomBodyForce::setExpression(const string& component, const string& expression) {
    expressions[componentIndex(component, "setExpression()")] = expression;
}

// ---- Parameters ----

/** @param present  the name that is to be replaced, if any */
void CustomBodyForce::checkName(const string& name, const char* method,
                                const string* present) const {
    const bool cannotStandInExpression =
        name.empty() || name[0] == '.' || (name[0] >= '0' && name[0] <= '9') ||
        name.find_first_of("+-*/^(),;= \t\n\v\f\r") != string::npos;
    if (cannotStandInExpression)
        fail(method, "the name '" + name + "' could not be used in an expression",
             "a name has no spaces, operators, parentheses, commas, semicolons or '=', and does "
             "not begin with a digit",
             "choose another name");
    const auto& variables = variableNames();
    if (find(variables.begin(), variables.end(), name) != variables.end())
        fail(method, "the name '" + name + "' is that of a variable",
             "x y z q0 q1 q2 q3 vx vy vz t have a meaning of their own", "choose another name");
    if (present != nullptr && *present == name) return;
    bool taken =
        find(perBodyParameters.begin(), perBodyParameters.end(), name) != perBodyParameters.end();
    for (const GlobalParameter& parameter : globalParameters)
        taken = taken || parameter.name == name;
    if (taken)
        fail(method, "there is a parameter '" + name + "' already",
             "parameters of one force need different names", "choose another name");
}

int CustomBodyForce::getNumPerBodyParameters() const { return perBodyParameters.size(); }

int CustomBodyForce::addPerBodyParameter(const string& name) {
    checkName(name, "addPerBodyParameter()", nullptr);
    perBodyParameters.push_back(name);
    return perBodyParameters.size() - 1;
}

const string& CustomBodyForce::getPerBodyParameterName(int index) const {
    checkIndex(index, perBodyParameters.size(), "getPerBodyParameterName()", "per-body parameters");
    return perBodyParameters[index];
}

void CustomBodyForce::setPerBodyParameterName(int index, const string& name) {
    checkIndex(index, perBodyParameters.size(), "setPerBodyParameterName()", "per-body parameters");
    checkName(name, "setPerBodyParameterName()", &perBodyParameters[index]);
    perBodyParameters[index] = name;
}

int CustomBodyForce::getNumGlobalParameters() const { return globalParameters.size(); }

int CustomBodyForce::addGlobalParameter(const string& name, double defaultValue) {
    checkName(name, "addGlobalParameter()", nullptr);
    checkFinite(defaultValue, "addGlobalParameter()", "the default value of '" + name + "'");
    globalParameters.push_back({name, defaultValue});
    return globalParameters.size() - 1;
}

const string& CustomBodyForce::getGlobalParameterName(int index) const {
    checkIndex(index, globalParameters.size(), "getGlobalParameterName()", "global parameters");
    return globalParameters[index].name;
}

void CustomBodyForce::setGlobalParameterName(int index, const string& name) {
    checkIndex(index, globalParameters.size(), "setGlobalParameterName()", "global parameters");
    checkName(name, "setGlobalParameterName()", &globalParameters[index].name);
    globalParameters[index].name = name;
}

double CustomBodyForce::getGlobalParameterDefaultValue(int index) const {
    checkIndex(index, globalParameters.size(), "getGlobalParameterDefaultValue()",
               "global parameters");
    return globalParameters[index].defaultValue;
}

void CustomBodyForce::setGlobalParameterDefaultValue(int index, double defaultValue) {
    checkIndex(index, globalParameters.size(), "setGlobalParameterDefaultValue()",
               "global parameters");
    checkFinite(defaultValue, "setGlobalParameterDefaultValue()",
                "the default value of '" + globalParameters[index].name + "'");
    globalParameters[index].defaultValue = defaultValue;
}

// ---- Bodies ----

CustomBodyForce::Entry CustomBodyForce::makeEntry(int bodyIndex, const vector<double>& parameters,
                                                  int index) const {
    const string object = "entry " + to_string(index);
    if (bodyIndex < 0)
        fail(object, "body index " + to_string(bodyIndex) + " is negative",
             "bodies are counted from 0", "correct the index");
    for (size_t i = 0; i < parameters.size(); i++)
        checkFinite(parameters[i], object,
                    i < perBodyParameters.size() ? "parameter '" + perBodyParameters[i] + "'"
                                                 : "parameter " + to_string(i));
    return {bodyIndex, parameters};
}

int CustomBodyForce::getNumBodies() const { return entries.size(); }

int CustomBodyForce::addBody(int bodyIndex, const vector<double>& parameters) {
    entries.push_back(makeEntry(bodyIndex, parameters, entries.size()));
    return entries.size() - 1;
}

void CustomBodyForce::getBodyParameters(int index, int& bodyIndex,
                                        vector<double>& parameters) const {
    checkIndex(index, entries.size(), "getBodyParameters()", "entries");
    bodyIndex = entries[index].body;
    parameters = entries[index].parameters;
}

void CustomBodyForce::setBodyParameters(int index, int bodyIndex,
                                        const vector<double>& parameters) {
    checkIndex(index, entries.size(), "setBodyParameters()", "entries");
    entries[index] = makeEntry(bodyIndex, parameters, index);
}

// ---- What OpenMM calls ----

void CustomBodyForce::updateParametersInContext(Context& context) {
    dynamic_cast<CustomBodyForceImpl&>(getImplInContext(context))
        .updateParametersInContext(getContextImpl(context));
}

bool CustomBodyForce::usesPeriodicBoundaryConditions() const { return false; }

ForceImpl* CustomBodyForce::createImpl() const { return new CustomBodyForceImpl(*this); }

}  // namespace RigidHIPlugin
