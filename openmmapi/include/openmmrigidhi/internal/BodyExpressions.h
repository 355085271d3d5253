#ifndef OPENMMRIGIDHI_BODY_EXPRESSIONS_H_
#define OPENMMRIGIDHI_BODY_EXPRESSIONS_H_

#include <array>
#include <string>
#include <vector>

#include "openmmrigidhi/internal/Errors.h"
#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * The contents of a Force that acts on bodies by expressions: six expressions, parameters, and the
 * bodies, each with its values of the per-body parameters. CustomBodyForce and CustomBodyMotion
 * each hold such an object, and document the methods of the same names.
 */
class OPENMM_EXPORT_RIGIDHI BodyExpressions {
public:
    /** What distinguishes one class of Forces from another. */
    struct Kind {
        const char* className;
        std::array<std::string, 6> components;  // in the order of the constructor
        std::vector<std::string> variables;     // that expressions may use besides parameters
    };
    /** @param kind  must outlive this object */
    BodyExpressions(const Kind& kind, const std::array<std::string, 6>& expressions)
        : kind(&kind), fail(kind.className), expressions(expressions) {}
    const Kind& getKind() const { return *kind; }
    /** All names that expressions may use: variables, per-body parameters, global parameters. */
    std::vector<std::string> getNames() const;

    const std::string& getExpression(const std::string& component) const;
    void setExpression(const std::string& component, const std::string& expression);

    int getNumPerBodyParameters() const { return perBodyParameters.size(); }
    int addPerBodyParameter(const std::string& name);
    const std::string& getPerBodyParameterName(int index) const;
    void setPerBodyParameterName(int index, const std::string& name);

    int getNumGlobalParameters() const { return globalParameters.size(); }
    int addGlobalParameter(const std::string& name, double defaultValue);
    const std::string& getGlobalParameterName(int index) const;
    void setGlobalParameterName(int index, const std::string& name);
    double getGlobalParameterDefaultValue(int index) const;
    void setGlobalParameterDefaultValue(int index, double defaultValue);

    int getNumBodies() const { return entries.size(); }
    int addBody(int bodyIndex, const std::vector<double>& parameters);
    void getBodyParameters(int index, int& bodyIndex, std::vector<double>& parameters) const;
    void setBodyParameters(int index, int bodyIndex, const std::vector<double>& parameters);

private:
    struct GlobalParameter {
        std::string name;
        double defaultValue;
    };
    struct Entry {
        int body;
        std::vector<double> parameters;
    };
    void checkIndex(int index, size_t count, const char* method, const char* what) const;
    void checkFinite(double value, const std::string& object, const std::string& quantity) const;
    int componentIndex(const std::string& component, const char* method) const;
    void checkName(const std::string& name, const char* method, const std::string* present) const;
    Entry makeEntry(int bodyIndex, const std::vector<double>& parameters, int index) const;

    const Kind* kind;
    ErrorsOf fail;
    std::array<std::string, 6> expressions;
    std::vector<std::string> perBodyParameters;
    std::vector<GlobalParameter> globalParameters;
    std::vector<Entry> entries;
};

}  // namespace RigidHIPlugin

#endif
