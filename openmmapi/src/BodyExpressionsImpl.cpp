#include "openmmrigidhi/internal/BodyExpressionsImpl.h"

#include <cxxabi.h>
#include <openmm/internal/ContextImpl.h>

#include <cstdlib>
#include <typeinfo>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** The name of an object's class, as in C++ but without its namespace. */
template <class T>
string className(const T& object) {
    int status = 0;
    char* demangled = abi::__cxa_demangle(typeid(object).name(), nullptr, nullptr, &status);
    string name = demangled == nullptr ? typeid(object).name() : demangled;
    free(demangled);
    return name.substr(name.rfind(':') + 1);
}

ErrorsOf errorsOf(const BodyExpressions& expressions) {
    return ErrorsOf(expressions.getKind().className);
}

/** Copy the entries of a force into two lists, and check that each entry has its parameters. */
void copyEntries(const BodyExpressions& force, int numParameters, vector<int>& bodies,
                 vector<double>& parameters) {
    const ErrorsOf fail = errorsOf(force);
    bodies.clear();
    parameters.clear();
    for (int i = 0; i < force.getNumBodies(); i++) {
        int body;
        vector<double> values;
        force.getBodyParameters(i, body, values);
        if ((int)values.size() != numParameters)
            fail("entry " + to_string(i) + " (body " + to_string(body) + ") has " +
                 to_string(values.size()) + " parameters, but the force has " +
                 to_string(numParameters) +
                 " per-body parameters; give addBody() or setBodyParameters() one value for each");
        bodies.push_back(body);
        parameters.insert(parameters.end(), values.begin(), values.end());
    }
}

}  // namespace

BodyExpressionsImpl::BodyExpressionsImpl(const BodyExpressions& expressions)
    : expressions(expressions), numParameters(expressions.getNumPerBodyParameters()) {}

void BodyExpressionsImpl::initialize(ContextImpl& context) {
    const ErrorsOf fail = errorsOf(expressions);
    const Integrator& integrator = context.getIntegrator();
    const auto* ours = dynamic_cast<const CustomRigidHIIntegrator*>(&integrator);
    if (ours == nullptr)
        fail("the Context's integrator is a " + className(integrator) +
             ", which has no rigid bodies; a " + expressions.getKind().className +
             " works only under a CustomRigidHIIntegrator: use this integrator, or remove the "
             "force from the System");
    copyEntries(expressions, numParameters, bodies, parameters);
    for (size_t i = 0; i < bodies.size(); i++)
        if (bodies[i] >= ours->getNumRigidBodies())
            fail("entry " + to_string(i) + " acts on body " + to_string(bodies[i]) +
                 ", but the integrator's " + to_string(ours->getNumRigidBodies()) +
                 " bodies are numbered from 0: add the body to the integrator, or correct the "
                 "entry");
}

map<string, double> BodyExpressionsImpl::getDefaultParameters() {
    map<string, double> parameters;
    for (int i = 0; i < expressions.getNumGlobalParameters(); i++)
        parameters[expressions.getGlobalParameterName(i)] =
            expressions.getGlobalParameterDefaultValue(i);
    return parameters;
}

void BodyExpressionsImpl::updateParametersInContext(ContextImpl& context) {
    const ErrorsOf fail = errorsOf(expressions);
    vector<int> newBodies;
    vector<double> newParameters;
    copyEntries(expressions, numParameters, newBodies, newParameters);
    if (newBodies != bodies)
        fail(
            "updateParametersInContext(): the force acts on other bodies than when the Context was "
            "created, and only parameters can change without a new Context; call "
            "Context::reinitialize()");
    parameters = newParameters;
    context.systemChanged();
}

}  // namespace RigidHIPlugin
