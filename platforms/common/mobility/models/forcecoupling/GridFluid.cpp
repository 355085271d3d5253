#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

using Eigen::MatrixXd;
using Eigen::VectorXd;

void GridFluid::multiply(const GridStencils& stencils, double viscosity, const MatrixXd& forces,
                         MatrixXd& velocities) {
    const std::lock_guard<std::mutex> lock(inUse);
    velocities.resize(forces.rows(), forces.cols());
    for (int c = 0; c < forces.cols(); c++)
        multiplyColumn(stencils, viscosity, forces.col(c).data(), velocities.col(c).data());
}

void GridFluid::multiplyInSingle(const GridStencils& stencils, double viscosity,
                                 const MatrixXd& forces, MatrixXd& velocities) {
    const std::lock_guard<std::mutex> lock(inUse);
    velocities.resize(forces.rows(), forces.cols());
    for (int c = 0; c < forces.cols(); c++)
        multiplyColumnInSingle(stencils, viscosity, forces.col(c).data(), velocities.col(c).data());
}

void GridFluid::draw(const GridStencils& stencils, double viscosity, const NoiseStream& noise,
                     uint32_t purpose, GridField& field) {
    draw(stencils, viscosity, *modeNoise(noise, purpose), field);
}

void GridFluid::draw(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
                     GridField& field) {
    const std::lock_guard<std::mutex> lock(inUse);
    drawModes(stencils, viscosity, GridModeNoise(stencils.getShape(), noise), field);
}

void GridFluid::multiply(const std::vector<GridChannel>& channels, double viscosity, bool inSingle,
                         const VectorXd& forces, VectorXd& velocities) {
    const std::lock_guard<std::mutex> lock(inUse);
    velocities.resize(rowsOf(channels));
    multiplyChannels(channels, viscosity, inSingle, forces.data(), velocities.data());
}

void GridFluid::draw(const std::vector<GridChannel>& channels, double viscosity,
                     const NoiseStream& noise, uint32_t purpose, std::vector<GridField>& fields) {
    draw(channels, viscosity, *modeNoise(noise, purpose), fields);
}

void GridFluid::draw(const std::vector<GridChannel>& channels, double viscosity,
                     const ModeNoise& noise, std::vector<GridField>& fields) {
    const std::lock_guard<std::mutex> lock(inUse);
    fields.resize(channels.size());
    drawChannels(channels, viscosity, GridModeNoise(channels[0].stencils->getShape(), noise),
                 fields);
}

std::unique_ptr<ModeNoise> GridFluid::modeNoise(const NoiseStream& noise, uint32_t purpose) const {
    return std::make_unique<CounterModeNoise>(noise, purpose);
}

void GridFluid::average(const GridField& field, const GridStencils& stencils,
                        VectorXd& velocities) {
    const std::lock_guard<std::mutex> lock(inUse);
    velocities.resize(stencils.getParticles().numRows);
    averageColumn(field, stencils, velocities.data());
}

void GridFluid::averageGradients(const GridField& field, const GridStencils& stencils,
                                 MatrixXd& gradients) {
    const std::lock_guard<std::mutex> lock(inUse);
    gradients.resize(9, stencils.size());
    averageGradientColumn(field, stencils, gradients.data());
}

}  // namespace RigidHIPlugin
