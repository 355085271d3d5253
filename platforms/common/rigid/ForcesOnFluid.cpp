#include "rigid/ForcesOnFluid.h"

#include <Eigen/Geometry>

#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

ForcesOnFluid::ForcesOnFluid(
    const RigidMotion& motion,
    const function<unique_ptr<MobilityModel>(const HydrodynamicParticles&)>& makeModel)
    : motion(motion), firstRow(motion.getParticles().numRows) {
    HydrodynamicParticles all = motion.getParticles();
    for (const FluidElement& element : motion.getElements())
        for (const ForceOnFluid& force : element.forcesOnFluid)
            all.add(force.radius, false, element.particles[0], element.body);
    model = makeModel(all);
}

bool ForcesOnFluid::areIn(const vector<FluidElement>& elements) {
    for (const FluidElement& element : elements)
        if (!element.forcesOnFluid.empty()) return true;
    return false;
}

void ForcesOnFluid::place(const vector<Pose>& poses, const vector<Matrix3d>& turns,
                          Placement& placement) const {
    motion.place(poses, turns, placement);
    for (size_t e = 0; e < motion.getElements().size(); e++)
        for (const ForceOnFluid& force : motion.getElements()[e].forcesOnFluid)
            placement.positions.push_back(toVec3(poses[e].R + turns[e] * force.site));
}

void ForcesOnFluid::forces(const vector<Matrix3d>& turns, MatrixXd& forces) const {
    forces.setZero(model->getParticles().numRows, 1);
    int row = firstRow;
    for (size_t e = 0; e < motion.getElements().size(); e++)
        for (const ForceOnFluid& force : motion.getElements()[e].forcesOnFluid) {
            forces.block<3, 1>(row, 0) = turns[e] * force.force;
            row += 3;
        }
}

Matrix<double, 6, 1> ForcesOnFluid::wrench_body(const FluidElement& element) {
    Matrix<double, 6, 1> wrench = Matrix<double, 6, 1>::Zero();
    for (const ForceOnFluid& force : element.forcesOnFluid) {
        wrench.head<3>() -= force.force;
        wrench.tail<3>() -= force.site.cross(force.force);
    }
    return wrench;
}

void ForcesOnFluid::addWrenches(const vector<Matrix3d>& turns, MatrixXd& wrenches) const {
    for (size_t e = 0; e < motion.getElements().size(); e++) {
        const FluidElement& element = motion.getElements()[e];
        if (element.forcesOnFluid.empty()) continue;
        wrenches.block<6, 1>(motion.firstRow(e), 0) +=
            twoRotations(turns[e]) * wrench_body(element);
    }
}

}  // namespace RigidHIPlugin
