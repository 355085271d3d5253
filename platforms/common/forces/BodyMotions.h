#ifndef RIGIDHI_BODY_MOTIONS_H_
#define RIGIDHI_BODY_MOTIONS_H_

#include <openmm/internal/ForceImpl.h>

#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "openmmrigidhi/MobilityForce.h"
#include "rigidbody/BodyGeometry.h"
#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/** The components of a body's twist that a CustomBodyMotion prescribes. */
struct PrescribedComponents {
    static constexpr unsigned all = (1u << 6) - 1;
    int force = -1;           // index of the CustomBodyMotion in the System
    unsigned components = 0;  // a bit for each of vx, vy, vz, wx, wy, wz
    unsigned zeros = 0;       // the prescribed components whose expression is the number 0
    bool inBody = false;      // along the axes of the body frame, not of the lab

    bool areAll() const { return components == all; }
    bool operator==(const PrescribedComponents& other) const {
        return force == other.force && components == other.components && zeros == other.zeros &&
               inBody == other.inBody;
    }
    /** The names of the prescribed components, such as "vz, wx". */
    std::string names() const;
};

/** The axes of the user's body frame in the inner frame, as columns. */
Eigen::Matrix3d userAxes(const BodySet& bodies, int body);

/**
 * All CustomBodyMotions of a Context, ready for evaluation. Without such forces isOn() is false,
 * callers need no other method, and the cost is zero.
 */
class BodyMotions {
public:
    BodyMotions();
    ~BodyMotions();
    /**
     * Find the forces among the ForceImpls of a Context and compile their expressions.
     *
     * @throws OpenMMException for an expression that does not compile, or for a body in two forces
     */
    BodyMotions(const std::vector<OpenMM::ForceImpl*>& impls, int numBodies);
    BodyMotions& operator=(BodyMotions&&);

    /** Whether the motion of any body is prescribed. */
    bool isOn() const { return !prescribed.empty(); }
    /** Whether any expression depends on time. */
    bool usesTime() const { return time; }
    /** The prescribed components by body, which are constant in a Context. */
    const std::map<int, PrescribedComponents>& getPrescribed() const { return prescribed; }
    /**
     * The prescribed components at a time, in the frame in which they are prescribed.
     *
     * @param parametersOfContext  values of global parameters
     * @param t                    time, ps
     * @param values               a column of 6 for each body; components that are free become 0
     * @throws OpenMMException for a value that is not finite
     */
    void evaluate(const std::map<std::string, double>& parametersOfContext, double t,
                  Eigen::MatrixXd& values);
    /**
     * Refuse spins about the line of a rod of blobs, on which a fluid has no effect.
     *
     * @param geometries  of all bodies
     * @param fluid       null: none
     */
    void checkSpins(const std::vector<BodyGeometry>& geometries,
                    const std::vector<std::vector<int>>& particlesOfBodies,
                    const MobilityForce* fluid) const;
    /** For describeEffects(). */
    std::string describe() const;

private:
    struct Motion;
    std::vector<std::unique_ptr<Motion>> motions;
    std::map<int, PrescribedComponents> prescribed;
    int numBodies = 0;
    bool time = false;
};

}  // namespace RigidHIPlugin

#endif
