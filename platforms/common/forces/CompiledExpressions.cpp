#include "forces/CompiledExpressions.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

CompiledExpressions::CompiledExpressions(int force, const BodyExpressionsImpl& impl)
    : force(force), impl(impl), numPerBody(impl.getExpressions().getNumPerBodyParameters()),
      firstParameter(impl.getExpressions().getKind().variables.size()),
      names(impl.getExpressions().getNames()) {
    globals.assign(names.begin() + firstParameter + numPerBody, names.end());
    values.assign(names.size(), 0.0);
}

void CompiledExpressions::compile(const string& component) {
    const BodyExpressions& source = impl.getExpressions();
    const ErrorsOf fail(source.getKind().className);
    try {
        expressions_.emplace_back(source.getExpression(component), names, values.data());
    } catch (const OpenMMException& error) {
        fail("force " + to_string(force) + ": " + component, error.what());
    }
}

bool CompiledExpressions::uses(int first, int end) const {
    for (const Expression& e : expressions_)
        for (int v = first; v < end; v++)
            if (e.uses(v)) return true;
    return false;
}

void CompiledExpressions::setGlobals(const map<string, double>& parametersOfContext) {
    const ErrorsOf fail(impl.getExpressions().getKind().className);
    double* global = values.data() + firstParameter + numPerBody;
    for (const string& name : globals) {
        // Functions such as step() and min() would hide a NaN, because they turn it into a finite
        // value.
        const double value = parametersOfContext.at(name);
        if (!isfinite(value))
            fail("the Context's parameter '" + name + "' of force " + to_string(force) + " is " +
                 text(value) + "; set a finite value by setParameter()");
        *global++ = value;
    }
}

void CompiledExpressions::setEntry(int entry) {
    const double* parameters = impl.getParameters().data() + entry * numPerBody;
    copy(parameters, parameters + numPerBody, values.data() + firstParameter);
}

}  // namespace RigidHIPlugin
