#include "mobility/models/ewald/SplitParts.h"

#include <cmath>

namespace RigidHIPlugin {

SplitParts::SplitParts(const HydrodynamicParticles& particles, double viscosity,
                       const std::vector<EwaldKind>& kinds, GridFluid& fluid)
    : viscosity(viscosity), fluid(fluid), near(particles, haveStresslets(kinds)),
      waves(particles, kinds) {
    for (double radius : particles.radii)
        for (size_t k = 0; k < kinds.size(); k++)
            if (kinds[k].radius == radius) kindOfParticle.push_back(k);
}

void SplitParts::setBox(const std::shared_ptr<const SplitBox>& newBox) {
    if (newBox == box) return;
    box = newBox;
    near.setTables(box->tables, kindOfParticle, box->splitting.shape);
    waves.setBox(*box);
    anchor.clear();
    isOwnAnchor = false;
}

void SplitParts::moveTo(const std::vector<OpenMM::Vec3>& positions, bool nearby) {
    waves.moveTo(positions, nearby);
    near.moveTo(positions, nearby, box->spacing, ranges());
    isOwnAnchor = !nearby;
    if (!nearby) anchor = positions;
}

void SplitParts::multiplyPairs(const MatrixXd& forces, MatrixXd& velocities) {
    const std::lock_guard<std::mutex> lock(inUse);
    velocities.resize(forces.rows(), forces.cols());
    for (int c = 0; c < forces.cols(); c++)
        near.multiply(forces.col(c).data(), velocities.col(c).data(), ranges());
    velocities *= 1 / (8 * M_PI * viscosity);
}

void SplitParts::multiply(const MatrixXd& forces, bool inSingle, MatrixXd& velocities) {
    multiplyPairs(forces, velocities);
    const std::lock_guard<std::mutex> lock(inUse);
    for (int c = 0; c < forces.cols(); c++)
        waves.addProduct(fluid, viscosity, inSingle, forces.col(c).data(),
                         velocities.col(c).data());
}

void SplitParts::draw(const NoiseStream& noise, uint32_t purpose, std::vector<GridField>& fields) {
    const std::lock_guard<std::mutex> lock(inUse);
    waves.draw(fluid, viscosity, noise, purpose, fields);
}

void SplitParts::addAverages(const std::vector<GridField>& fields, MatrixXd& velocities) {
    const std::lock_guard<std::mutex> lock(inUse);
    waves.addAverages(fluid, fields, velocities.data());
}

}  // namespace RigidHIPlugin
