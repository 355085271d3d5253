#ifndef OPENMMRIGIDHI_CUSTOM_BODY_MOTION_H_
#define OPENMMRIGIDHI_CUSTOM_BODY_MOTION_H_

#include <openmm/Context.h>
#include <openmm/Force.h>

#include <string>
#include <vector>

#include "openmmrigidhi/internal/BodyExpressions.h"
#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * Prescribed velocities of rigid bodies of a CustomRigidHIIntegrator, as expressions of time.
 *
 * Six expressions give the components of the velocity of the body's origin ("vx", "vy", "vz";
 * nm/ps) and of the angular velocity ("wx", "wy", "wz"; rad/ps). An empty expression leaves the
 * component free: forces, the fluid and noise then move the body along it. A component that is
 * prescribed has the value of its expression whatever forces act on the body.
 * CustomRigidHIIntegrator::computeHoldingWrenches() gives the wrench that this takes. For example,
 * a roller has a prescribed spin and is free otherwise, and "0" for vz keeps a body in a plane.
 *
 * Expressions are written in the language of OpenMM's Custom forces (definitions after semicolons
 * included). They may use
 *   - t: the time, ps; at each stage of a step, the time of that stage;
 *   - per-body parameters, with a value for each body that was added;
 *   - global parameters, which are parameters of the Context.
 *
 * Schemes without momenta in a fluid take any prescribed components. LangevinHI takes bodies with
 * all six components prescribed. Other schemes can hold bodies
 * (CustomRigidHIIntegrator::setBodyHeld()).
 *
 * A CustomBodyMotion has no energy and ignores OpenMM's force groups.
 *
 * Every error is an OpenMMException that names the object, the value, the bound and the remedy.
 * Methods throw for an index of a parameter or an entry that is out of range.
 */
class OPENMM_EXPORT_RIGIDHI CustomBodyMotion : public OpenMM::Force {
public:
    /** The frame in which components are prescribed. */
    enum Frame : int {
        /** Components are along the axes of the lab (default). */
        Lab = 0,
        /** Components are along the axes of the body frame, which turn with the body. */
        Body = 1
    };

    /**
     * Create a force from its six expressions. Context creation checks them. An empty expression
     * leaves its component free.
     *
     * @param vx, vy, vz  components of the velocity of the body's origin, nm/ps
     * @param wx, wy, wz  components of the angular velocity, rad/ps
     */
    CustomBodyMotion(const std::string& vx, const std::string& vy, const std::string& vz,
                     const std::string& wx, const std::string& wy, const std::string& wz);
    ~CustomBodyMotion();

    /**
     * Get one of the six expressions.
     * @param component  "vx", "vy", "vz", "wx", "wy" or "wz"
     * @throws OpenMMException for any other component
     */
    const std::string& getExpression(const std::string& component) const;
    /**
     * Set one of the six expressions; an empty one leaves the component free. Takes effect at the
     * next Context creation or reinitialize(). Errors are as in getExpression().
     */
    void setExpression(const std::string& component, const std::string& expression);

    /** Get the frame in which components are prescribed. */
    Frame getFrame() const;
    /**
     * Set the frame in which components are prescribed (default Lab). Takes effect at the next
     * Context creation or reinitialize().
     * @throws OpenMMException for a value that is none of the enumerators
     */
    void setFrame(Frame frame);

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

    /** Get the number of entries (bodies whose motion is prescribed). */
    int getNumBodies() const;
    /**
     * Prescribe the motion of a body. A body may be in one entry of one CustomBodyMotion only.
     * @param bodyIndex   index of the body in the integrator
     * @param parameters  values of the per-body parameters
     * @return index of the entry
     * @throws OpenMMException for a negative body index, or a value that is not finite. At Context
     *     creation: for a body that does not exist or is held, for a body that is in another entry
     *     or in another CustomBodyMotion, or if the number of values is not the number of per-body
     *     parameters
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
    /** Get whether this force uses periodic boundary conditions. It does not. */
    bool usesPeriodicBoundaryConditions() const override;

    /** @private Expressions, parameters and bodies, for the other parts of the library. */
    const BodyExpressions& getBodyExpressions() const { return expressions; }

protected:
    OpenMM::ForceImpl* createImpl() const override;

private:
    Frame frame;
    BodyExpressions expressions;
};

}  // namespace RigidHIPlugin

#endif
