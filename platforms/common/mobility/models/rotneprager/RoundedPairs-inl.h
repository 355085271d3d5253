// Packs of pairs of which some overlap. Their mobility is computed in double precision, whatever
// the precision of the sum. The build compiles this file once for each instruction set.

#if defined(RIGIDHI_ROUNDED_PAIRS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_ROUNDED_PAIRS_INL_H_
#undef RIGIDHI_ROUNDED_PAIRS_INL_H_
#else
#define RIGIDHI_ROUNDED_PAIRS_INL_H_
#endif

#include "mobility/models/rotneprager/RotnePragerYamakawa-inl.h"
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

/**
 * The mobility of a pack of pairs, rounded to the precision of Real.
 *
 * @param pairs  pairs(k), k = 0 ... Real::packs - 1, gives the PairMobility<Pack> of the k-th
 *     doubles
 */
template <class Real, class Pairs>
HWY_INLINE PairMobility<Real> roundedPairs(Pairs pairs) {
    constexpr int packs = Real::packs;
    using Pack = decltype(pairs(0).ttI);
    Pack ttI[packs], ttR[packs], tr[packs], rt[packs], rrI[packs], rrR[packs];
    for (int k = 0; k < packs; k++) {
        const PairMobility<Pack> m = pairs(k);
        ttI[k] = m.ttI;
        ttR[k] = m.ttR;
        tr[k] = m.tr;
        rt[k] = m.rt;
        rrI[k] = m.rrI;
        rrR[k] = m.rrR;
    }
    PairMobility<Real> m;
    round(ttI, m.ttI);
    round(ttR, m.ttR);
    round(tr, m.tr);
    round(rt, m.rt);
    round(rrI, m.rrI);
    round(rrR, m.rrR);
    return m;
}

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif  // RIGIDHI_ROUNDED_PAIRS_INL_H_
