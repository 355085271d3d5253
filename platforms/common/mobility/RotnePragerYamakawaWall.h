#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_H_

#include "mobility/NoSlipPlane.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility above a no-slip plane z = height: the free one and its image in the wall, pair by pair, in
 * plain loops. Formulas, reference and limits: RotnePragerYamakawaWall-inl.h and RotnePragerYamakawa-inl.h.
 *
 * Particles may overlap each other. Two of one radius at the same place (crossing: above each other, both with centres below
 * their radius) make the matrix singular, not indefinite.
 * Cost: two to three times that of unbounded fluid; dense() about twice.
 * Nothing is allocated after the first call of each method, if the number of columns stays the same.
 */
class RotnePragerYamakawaWall : public MobilityOperator {
public:
    RotnePragerYamakawaWall(const HydrodynamicParticles& particles, double viscosity, const NoSlipPlane& wall)
        : MobilityOperator(particles, viscosity), wall(wall), positions(particles.size()), weights(particles.size()) {}
    void setPositions(const std::vector<OpenMM::Vec3>& positions) override;
    void setPositionsNearby(const std::vector<OpenMM::Vec3>& positions) override;
    bool acceptsNearby(const std::vector<OpenMM::Vec3>& positions) const override {
        return wall.acceptsNearby(particles, positions);
    }
    std::string objection(const std::vector<OpenMM::Vec3>& positions) const override {
        return wall.objection(particles, positions);
    }
    bool mayObject() const override { return true; }
    OpenMM::Vec3 placeInFormulas(int i, const OpenMM::Vec3& position) const override {
        return wall.placeInFormulas(position, particles.radii[i]);
    }
    void apply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) const override;
    void dense(Eigen::MatrixXd& mobility) const override;

private:
    const NoSlipPlane wall;
    std::vector<OpenMM::Vec3> positions;  // z from the wall, at least the radius
    std::vector<double> weights;          // B
};

}  // namespace RigidHIPlugin

#endif
