#include "openmmrigidhi/internal/BodyExpressions.h"

#include <algorithm>
#include <cmath>

using namespace std;

namespace RigidHIPlugin {

namespace {

template <class Texts>
string joined(const Texts& texts, const char* separator) {
    string result;
    for (const string& text : texts) result += (result.empty() ? "" : separator) + text;
    return result;
}

}  // namespace

vector<string> BodyExpressions::getNames() const {
    vector<string> names = kind->variables;
    names.insert(names.end(), perBodyParameters.begin(), perBodyParameters.end());
    for (const GlobalParameter& parameter : globalParameters) names.push_back(parameter.name);
    return names;
}

void BodyExpressions::checkIndex(int index, size_t count, const char* method,
                                 const char* what) const {
    if (index < 0 || index >= (int)count)
        fail(method, "index " + to_string(index) + " is out of range",
             "this force has " + to_string(count) + " " + what + ", numbered from 0",
             "add what is missing first, or correct the index");
}

void BodyExpressions::checkFinite(double value, const string& object,
                                  const string& quantity) const {
    if (isfinite(value)) return;
    fail(object, quantity + " is " + number(value), "parameters must be finite");
}

int BodyExpressions::componentIndex(const string& component, const char* method) const {
    const auto& names = kind->components;
    const auto found = find(names.begin(), names.end(), component);
    if (found == names.end())
        fail(method, "component '" + component + "' is unknown",
             "the components are " + joined(names, ", "));
    return found - names.begin();
}

const string& BodyExpressions::getExpression(const string& component) const {
    return expressions[componentIndex(component, "getExpression()")];
}

void BodyExpressions::setExpression(const string& component, const string& expression) {
    expressions[componentIndex(component, "setExpression()")] = expression;
}

// ---- Parameters ----

/** @param present  the name to be replaced, if any */
void BodyExpressions::checkName(const string& name, const char* method,
                                const string* present) const {
    const bool cannotStandInExpression =
        name.empty() || name[0] == '.' || (name[0] >= '0' && name[0] <= '9') ||
        name.find_first_of("+-*/^(),;= \t\n\v\f\r") != string::npos;
    if (cannotStandInExpression)
        fail(method, "the name '" + name + "' cannot stand in an expression",
             "a name has no spaces, operators, parentheses, commas, semicolons or '=', and does "
             "not begin with a digit",
             "choose another name");
    const auto& variables = kind->variables;
    if (find(variables.begin(), variables.end(), name) != variables.end())
        fail(method, "the name '" + name + "' is that of a variable",
             joined(variables, " ") + (variables.size() == 1 ? " has a meaning of its own"
                                                             : " have a meaning of their own"),
             "choose another name");
    if (present != nullptr && *present == name) return;
    bool taken =
        find(perBodyParameters.begin(), perBodyParameters.end(), name) != perBodyParameters.end();
    for (const GlobalParameter& parameter : globalParameters)
        taken = taken || parameter.name == name;
    if (taken)
        fail(method, "the force already has a parameter '" + name + "'",
             "parameters of one force need different names", "choose another name");
}

int BodyExpressions::addPerBodyParameter(const string& name) {
    checkName(name, "addPerBodyParameter()", nullptr);
    perBodyParameters.push_back(name);
    return perBodyParameters.size() - 1;
}

const string& BodyExpressions::getPerBodyParameterName(int index) const {
    checkIndex(index, perBodyParameters.size(), "getPerBodyParameterName()", "per-body parameters");
    return perBodyParameters[index];
}

void BodyExpressions::setPerBodyParameterName(int index, const string& name) {
    checkIndex(index, perBodyParameters.size(), "setPerBodyParameterName()", "per-body parameters");
    checkName(name, "setPerBodyParameterName()", &perBodyParameters[index]);
    perBodyParameters[index] = name;
}

int BodyExpressions::addGlobalParameter(const string& name, double defaultValue) {
    checkName(name, "addGlobalParameter()", nullptr);
    checkFinite(defaultValue, "addGlobalParameter()", "the default value of '" + name + "'");
    globalParameters.push_back({name, defaultValue});
    return globalParameters.size() - 1;
}

const string& BodyExpressions::getGlobalParameterName(int index) const {
    checkIndex(index, globalParameters.size(), "getGlobalParameterName()", "global parameters");
    return globalParameters[index].name;
}

void BodyExpressions::setGlobalParameterName(int index, const string& name) {
    checkIndex(index, globalParameters.size(), "setGlobalParameterName()", "global parameters");
    checkName(name, "setGlobalParameterName()", &globalParameters[index].name);
    globalParameters[index].name = name;
}

double BodyExpressions::getGlobalParameterDefaultValue(int index) const {
    checkIndex(index, globalParameters.size(), "getGlobalParameterDefaultValue()",
               "global parameters");
    return globalParameters[index].defaultValue;
}

void BodyExpressions::setGlobalParameterDefaultValue(int index, double defaultValue) {
    checkIndex(index, globalParameters.size(), "setGlobalParameterDefaultValue()",
               "global parameters");
    checkFinite(defaultValue, "setGlobalParameterDefaultValue()",
                "the default value of '" + globalParameters[index].name + "'");
    globalParameters[index].defaultValue = defaultValue;
}

// ---- Bodies ----

BodyExpressions::Entry BodyExpressions::makeEntry(int bodyIndex, const vector<double>& parameters,
                                                  int index) const {
    const string object = "entry " + to_string(index);
    if (bodyIndex < 0)
        fail(object, "body index " + to_string(bodyIndex) + " is negative",
             "bodies are counted from 0");
    for (size_t i = 0; i < parameters.size(); i++)
        checkFinite(parameters[i], object,
                    i < perBodyParameters.size() ? "parameter '" + perBodyParameters[i] + "'"
                                                 : "parameter " + to_string(i));
    return {bodyIndex, parameters};
}

int BodyExpressions::addBody(int bodyIndex, const vector<double>& parameters) {
    entries.push_back(makeEntry(bodyIndex, parameters, entries.size()));
    return entries.size() - 1;
}

void BodyExpressions::getBodyParameters(int index, int& bodyIndex,
                                        vector<double>& parameters) const {
    checkIndex(index, entries.size(), "getBodyParameters()", "entries");
    bodyIndex = entries[index].body;
    parameters = entries[index].parameters;
}

void BodyExpressions::setBodyParameters(int index, int bodyIndex,
                                        const vector<double>& parameters) {
    checkIndex(index, entries.size(), "setBodyParameters()", "entries");
    entries[index] = makeEntry(bodyIndex, parameters, index);
}

}  // namespace RigidHIPlugin
