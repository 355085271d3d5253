#include "rigid/BodyMobilities.h"

#include "rigid/ConstantMobility.h"
#include "rigid/DenseMobility.h"
#include "rigid/KrylovMobility.h"

namespace RigidHIPlugin {

BodyMobility& BodyMobilities::get(BodyMobility::Way way) {
    std::unique_ptr<BodyMobility>& strategy = made[way];
    if (!strategy) {
        if (way == BodyMobility::Constant)
            strategy = std::make_unique<ConstantMobility>(bodies);
        else if (way == BodyMobility::Dense)
            strategy = std::make_unique<DenseMobility>(bodies);
        else
            strategy = std::make_unique<KrylovMobility>(bodies, tolerance);
    }
    return *strategy;
}

MobilityCosts BodyMobilities::getCosts() const {
    MobilityCosts sum;
    for (const auto& strategy : made)
        if (strategy) sum.add(strategy->getCosts());
    return sum;
}

}  // namespace RigidHIPlugin
