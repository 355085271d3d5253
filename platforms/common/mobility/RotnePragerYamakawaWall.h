#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_H_

#include "mobility/MobilityOperator.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility above a no-slip plane z = height: the free one and its image in the wall, pair by pair, in
 * plain loops. Formulas, reference and limits: RotnePragerYamakawaWall-inl.h and RotnePragerYamakawa-inl.h.
 *
 * Where the surface of a particle reaches through the wall the formulas do not hold. Such positions are refused, or, with
 * crossing allowed, every particle of radius a with its centre at 0 < z < a over the wall counts as touching it, and its
 * velocities and its forces (and what belongs to rotation) are multiplied by z/a: M -> B M B, B = diag(min(1, z/a)), M at
 * max(z, a). That is continuous and keeps the matrix symmetric positive definite. Centres on the wall or behind are refused.
 *
 * Particles may overlap each other. Two of one radius at the same place (crossing: above each other, both with centres below
 * their radius) make the matrix singular, not indefinite.
 * Cost: two to three times that of unbounded fluid; dense() about four times.
 * Nothing is allocated after the first call of each method, if the number of columns stays the same.
 */
class RotnePragerYamakawaWall : public MobilityOperator {
public:
    /**
     * @param wallHeight       z of the wall, nm; the fluid is above it
     * @param crossingAllowed  whether surfaces of particles may reach through the wall
     * @throws OpenMMException if the height is not finite
     */
    RotnePragerYamakawaWall(const HydrodynamicParticles& particles, double viscosity, double wallHeight,
                            bool crossingAllowed);
    void setPositions(const std::vector<OpenMM::Vec3>& positions) override;
    std::string objection(const std::vector<OpenMM::Vec3>& positions) const override;
    bool mayObject() const override { return true; }
    void apply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) const override;
    void dense(Eigen::MatrixXd& mobility) const override;

private:
    const double wallHeight;
    const bool crossingAllowed;
    std::vector<OpenMM::Vec3> positions;  // z from the wall, at least the radius
    std::vector<double> weights;          // B
};

}  // namespace RigidHIPlugin

#endif
