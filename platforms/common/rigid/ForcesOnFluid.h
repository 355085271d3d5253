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
 * Forces that bodies exert on the fluid at sites that move with the bodies. Each site is an
 * additional particle p of the model, without torque, and exerts the force f. This adds M_ip f to
 * the slips of every particle i. The body takes the opposite wrench: the force -f and the torque
 * -(x_p - R) x f.
 *
 * The data do not depend on where the bodies are, so that several objects may use them at once.
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
    /** The forces of the model's particles: 0 except at the sites. */
    void forces(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& forces) const;
    /** Add the wrenches that the bodies take to one column of wrenches. */
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
