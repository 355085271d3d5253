#ifndef OPENMMRIGIDHI_CUSTOM_BODY_FORCE_H_
#define OPENMMRIGIDHI_CUSTOM_BODY_FORCE_H_

#include <openmm/Context.h>
#include <openmm/Force.h>

#include <string>
#include <vector>

#include "openmmrigidhi/internal/BodyExpressions.h"
#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * A force and a torque on rigid bodies of a CustomRigidHIIntegrator, as expressions.
 *
 * Six expressions give the components of the force ("fx", "fy", "fz"; kJ/(mol nm)) and of the
 * torque about the body's origin ("tx", "ty", "tz"; kJ/mol), all in the lab frame. They are written
 * in the language of OpenMM's Custom forces (definitions after semicolons included). An expression
 * may use
 *   - x, y, z: the position of the body's origin, nm, lab frame, unwrapped;
 *   - q0, q1, q2, q3: the orientation of the body, the unit quaternion (w, x, y, z) that turns
 *     body-frame vectors into lab-frame vectors. As q and -q are the same orientation and either
 *     may occur, only expressions that are even in q make sense;
 *   - vx, vy, vz: the velocity of the origin, nm/ps, lab frame (Langevin schemes only);
 *   - t: the time, ps;
 *   - per-body parameters, with a value for each body that was added;
 *   - global parameters, which are parameters of the Context.
 *
 * The integrator evaluates the expressions whenever it evaluates OpenMM's forces, with the
 * positions and the time of that evaluation, if the force group is one of the integrator's. The
 * forces have no energy: minimisers and barostats do not feel them.
 *
 * If expressions use velocities, the first half kick of a step takes the velocities at the
 * beginning of the step. The second half kick takes the velocities at its own end, predicted once.
 * The weak order is 2 with LangevinC and LangevinHI, and 1 with LangevinA and LangevinB (2 without
 * friction).
 *
 * Every error is an OpenMMException that names the object, the value, the bound and the remedy.
 * Methods throw for an index of a parameter or an entry that is out of range.
 */
class OPENMM_EXPORT_RIGIDHI CustomBodyForce : public OpenMM::Force {
public:
    /**
     * Create a force from its six expressions. Context creation checks them.
     *
     * @param fx, fy, fz  components of the force, kJ/(mol nm), lab frame
     * @param tx, ty, tz  components of the torque about the body's origin, kJ/mol, lab frame
     */
    CustomBodyForce(const std::string& fx, const std::string& fy, const std::string& fz,
                    const std::string& tx, const std::string& ty, const std::string& tz);
    ~CustomBodyForce();

    /**
     * Get one of the six expressions.
     * @param component  "fx", "fy", "fz", "tx", "ty" or "tz"
     * @throws OpenMMException for any other component
     */
    const std::string& getExpression(const std::string& component) const;
    /**
     * Set one of the six expressions. Takes effect at the next Context creation or reinitialize().
     * Errors are as in getExpression().
     */
    void setExpression(const std::string& component, const std::string& expression);

    /** Get the number of per-body parameters. */
    int getNumPerBodyParameters() const;
    /**
     * Add a per-body parameter.
     * @return its index
     * @throws OpenMMException for a name that no expression could contain, or that already has
     *     another meaning
     */
    int addPerBodyParameter(const std::string& name);
    /** Get the name of a per-body parameter. */
    const std::string& getPerBodyParameterName(int index) const;
    /** Set the name of a per-body parameter. Errors are as in addPerBodyParameter(). */
    void setPerBodyParameterName(int index, const std::string& name);

    /** Get the number of global parameters. */
    int getNumGlobalParameters() const;
    /**
     * Add a global parameter: a parameter of the Context (Context::setParameter()).
     * @param name          its name
     * @param defaultValue  its value in a new Context
     * @return its index
     * @throws OpenMMException as in addPerBodyParameter(), or for a value that is not finite
     */
    int addGlobalParameter(const std::string& name, double defaultValue);
    /** Get the name of a global parameter. */
    const std::string& getGlobalParameterName(int index) const;
    /** Set the name of a global parameter. Errors are as in addGlobalParameter(). */
    void setGlobalParameterName(int index, const std::string& name);
    /** Get the value of a global parameter in a new Context. */
    double getGlobalParameterDefaultValue(int index) const;
    /** Set the value of a global parameter in a new Context. @throws OpenMMException if it is not
     * finite */
    void setGlobalParameterDefaultValue(int index, double defaultValue);

    /** Get the number of entries (bodies on which this force acts). */
    int getNumBodies() const;
    /**
     * Let the force act on a body. A body that is added twice feels the force twice.
     * @param bodyIndex   index of the body in the integrator
     * @param parameters  values of the per-body parameters
     * @return index of the entry
     * @throws OpenMMException for a negative body index, or a value that is not finite. At Context
     *     creation: for a body that does not exist, or if the number of values is not the number of
     *     per-body parameters
     */
    int addBody(int bodyIndex, const std::vector<double>& parameters);
    /** Get the body and the parameters of an entry. */
    void getBodyParameters(int index, int& bodyIndex, std::vector<double>& parameters) const;
    /**
     * Set the body and the parameters of an entry. Takes effect at the next Context creation, or
     * with updateParametersInContext(). Errors are as in addBody().
     */
    void setBodyParameters(int index, int bodyIndex, const std::vector<double>& parameters);

    /**
     * Copy the per-body parameters of all entries to a Context. Expressions, names and the bodies
     * of the entries stay as they were at Context creation.
     * @throws OpenMMException if this force is not in the Context, or if anything but parameters
     *     has changed in the entries
     */
    void updateParametersInContext(OpenMM::Context& context);
    /**
     * Get whether this force uses periodic boundary conditions. It does not: positions are
     * unwrapped.
     */
    bool usesPeriodicBoundaryConditions() const override;

    /** @private Expressions, parameters and bodies, for the other parts of the library. */
    const BodyExpressions& getBodyExpressions() const { return expressions; }

protected:
    OpenMM::ForceImpl* createImpl() const override;

private:
    BodyExpressions expressions;
};

}  // namespace RigidHIPlugin

#endif
