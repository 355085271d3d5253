#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_H_

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility in unbounded fluid, pair by pair: plain loops, for few particles
 * and as the reference for faster ones. Formulas, reference and limits: RotnePragerYamakawa-inl.h.
 *
 * Accepts all positions. Two particles of one radius at the same place make the matrix singular,
 * not indefinite. Cost: one square root and about 60 operations a pair, apply() once per pair and
 * 40 operations more for each column. Nothing is allocated after the first call of each method of a
 * place, if the number of columns stays the same.
 */
class RotnePragerYamakawa : public MobilityModel {
public:
    using MobilityModel::MobilityModel;
    const char* name() const override { return "RotnePragerYamakawa"; }
    bool isHomogeneous() const override { return true; }
    bool isIsotropic() const override { return true; }
    bool isDivergenceFree() const override { return true; }

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;
};

}  // namespace RigidHIPlugin

#endif
