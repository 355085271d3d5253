#ifndef RIGIDHI_COMPILED_EXPRESSIONS_H_
#define RIGIDHI_COMPILED_EXPRESSIONS_H_

#include <map>
#include <string>
#include <vector>

#include "forces/Expression.h"
#include "openmmrigidhi/internal/BodyExpressionsImpl.h"

namespace RigidHIPlugin {

/**
 * The expressions of one Force for bodies, compiled, with the values of the names in them. Before
 * evaluating expressions, set the variables, the global parameters, and the parameters of an entry.
 */
class CompiledExpressions {
public:
    /**
     * @param force  its index in the System
     * @param impl   must outlive this object
     */
    CompiledExpressions(int force, const BodyExpressionsImpl& impl);
    /**
     * Compile the expression of a component, as the next of expressions(). @throws OpenMMException
     * if it does not compile
     */
    void compile(const std::string& component);

    int getForce() const { return force; }
    const std::vector<int>& getBodies() const { return impl.getBodies(); }
    std::vector<Expression>& expressions() { return expressions_; }
    /** Whether any expression uses a variable from first up to, but not including, end. */
    bool uses(int first, int end) const;

    /** The values of the variables, in the order of BodyExpressions::Kind. */
    double* variables() { return values.data(); }
    /** @throws OpenMMException for a value that is not finite */
    void setGlobals(const std::map<std::string, double>& parametersOfContext);
    /** Set the per-body parameters to those of an entry. */
    void setEntry(int entry);

private:
    int force;
    const BodyExpressionsImpl& impl;
    int numPerBody, firstParameter;
    std::vector<std::string> names, globals;
    std::vector<double> values;  // of names: variables, per-body parameters, global parameters
    std::vector<Expression> expressions_;
};

}  // namespace RigidHIPlugin

#endif
