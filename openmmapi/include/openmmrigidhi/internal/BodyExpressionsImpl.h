#ifndef OPENMMRIGIDHI_BODY_EXPRESSIONS_IMPL_H_
#define OPENMMRIGIDHI_BODY_EXPRESSIONS_IMPL_H_

#include <openmm/internal/ForceImpl.h>

#include <map>
#include <string>
#include <vector>

#include "openmmrigidhi/internal/BodyExpressions.h"

namespace RigidHIPlugin {

/**
 * A Force of expressions for bodies in a Context. It computes nothing itself. The integrator's
 * kernel, which has the bodies, finds this object among the Context's ForceImpls and evaluates the
 * expressions. The object holds the entries as they are in this Context.
 */
class OPENMM_EXPORT_RIGIDHI BodyExpressionsImpl : public OpenMM::ForceImpl {
public:
    /** @param expressions  of the owner */
    explicit BodyExpressionsImpl(const BodyExpressions& expressions);
    void initialize(OpenMM::ContextImpl& context) override;
    /**
     * Changes nothing. OpenMM's default reports that forces are invalid, so that every step would
     * evaluate them twice.
     */
    void updateContextState(OpenMM::ContextImpl& context, bool& forcesInvalid) override {}
    double calcForcesAndEnergy(OpenMM::ContextImpl& context, bool includeForces, bool includeEnergy,
                               int groups) override {
        return 0;
    }
    std::map<std::string, double> getDefaultParameters() override;
    std::vector<std::string> getKernelNames() override { return {}; }
    void updateParametersInContext(OpenMM::ContextImpl& context);

    const BodyExpressions& getExpressions() const { return expressions; }
    /** The body of each entry. */
    const std::vector<int>& getBodies() const { return bodies; }
    /** The parameters of all entries, one after the other. */
    const std::vector<double>& getParameters() const { return parameters; }

private:
    const BodyExpressions& expressions;
    std::vector<int> bodies;
    std::vector<double> parameters;
    int numParameters;
};

}  // namespace RigidHIPlugin

#endif
