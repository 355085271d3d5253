#ifndef RIGIDHI_FORCES_ON_FLUID_H_
#define RIGIDHI_FORCES_ON_FLUID_H_

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "mobility/MobilityModel.h"
#include "rigid/RigidMotion.h"

namespace RigidHIPlugin {

/**
 * Forces that bodies exert on the fluid at sites which move with them. Each site is a particle p of
 * its own in the model, without torque, which exerts the force f. Its body takes the opposite: the
 * slips of all particles have M_ip f, and the wrench of the body -f, -(x_p - R) x f.
 *
 * Data do not depend on where the bodies are, so that several objects may use them at once.
 */
class ForcesOnFluid {
public:
    /** @param makeModel  makes the model of given particles */
    ForcesOnFluid(const RigidMotion& motion,
                  const std::function<std::unique_ptr<MobilityModel>(const HydrodynamicParticles&)>&
                      makeModel);
    /** Whether some element exerts such a force. */
    static bool areIn(const std::vector<FluidElement>& elements);
    /** The model of the bodies' particles, followed by those of the sites. */
    const MobilityModel& getModel() const { return *model; }
    void place(const std::vector<Pose>& poses, const std::vector<Eigen::Matrix3d>& turns,
               Placement& placement) const;
    /** The forces of particles of the model: 0 but at the sites. */
    void forces(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& forces) const;
    /** Add what the bodies take to wrenches in one column. */
    void addWrenches(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& wrenches) const;
    /** The wrench that an element takes, in its frame. */
    static Eigen::Matrix<double, 6, 1> wrench_body(const FluidElement& element);

private:
    const RigidMotion motion;
    std::unique_ptr<const MobilityModel> model;
    int firstRow;  // of the sites
};

}  // namespace RigidHIPlugin

#endif
