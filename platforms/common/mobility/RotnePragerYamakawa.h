#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_H_

#include "mobility/MobilityOperator.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility in unbounded fluid, pair by pair: plain loops, for few particles and as the reference for
 * faster ones. Formulas, reference and limits: RotnePragerYamakawa-inl.h.
 *
 * Accepts all positions. Two particles of one radius at the same place make the matrix singular, not indefinite.
 * Cost: one square root and about 60 operations a pair, apply() once per pair and 40 operations more for each column.
 * Nothing is allocated after the first call of each method, if the number of columns stays the same.
 */
class RotnePragerYamakawa : public MobilityOperator {
public:
    RotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity);
    void setPositions(const std::vector<OpenMM::Vec3>& positions) override;
    void apply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) const override;
    void dense(Eigen::MatrixXd& mobility) const override;
    bool isDivergenceFree() const override { return true; }

private:
    std::vector<OpenMM::Vec3> positions;
};

}  // namespace RigidHIPlugin

#endif
