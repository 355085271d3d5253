#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_H_

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility in unbounded fluid, pair by pair, in plain loops. It suits few
 * particles and is the reference for faster models. Formulas, references and limits:
 * RotnePragerYamakawa-inl.h.
 *
 * The model accepts all positions. Two particles of one radius at the same place make the matrix
 * singular, not indefinite. Cost: one square root and about 60 operations for each pair, whatever
 * the number of columns. Each column of multiply() takes 40 operations more for each pair. Nothing
 * is allocated after the first call of each method of a MobilityAt, if the number of columns stays
 * the same.
 */
class RotnePragerYamakawa : public MobilityModel {
public:
    RotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity);
    std::unique_ptr<MobilityModel> forCollectiveModes(
        const HydrodynamicParticles& spheres) const override;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;
};

}  // namespace RigidHIPlugin

#endif
