// The tables of GridKernels.h. The build compiles them once for each instruction set.

#include "simd/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/models/forcecoupling/GridKernels.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "hwy/cache_control.h"
#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/models/forcecoupling/GridKernels.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

HWY_BEFORE_NAMESPACE();
#include "mobility/models/forcecoupling/GridKernels-inl.h"
#include "mobility/models/forcecoupling/GridPlanes-inl.h"
#include "mobility/models/forcecoupling/GridWalls-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

template <typename T>
constexpr GridKernels<T> gridKernels() {
    return {spreadToSlab<T>,    transformSlab<T>,     solveRow<T>,   solveRowsBetween<T>,
            solveRowsBeside<T>, transformSlabBack<T>, averageSlab<T>};
}
constexpr FieldKernels fieldKernels() {
    return {drawRow,          drawRowsBetween,           drawRowsBeside,
            fillSlab<double>, averageFilledSlab<double>, fillModes};
}

const GridKernels<double>& exactKernels() {
    static constexpr GridKernels<double> table = gridKernels<double>();
    return table;
}
const GridKernels<float>& singleKernels() {
    static constexpr GridKernels<float> table = gridKernels<float>();
    return table;
}
const FieldKernels& kernelsOfFields() {
    static constexpr FieldKernels table = fieldKernels();
    return table;
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(exactKernels);
HWY_EXPORT(singleKernels);
HWY_EXPORT(kernelsOfFields);

template <>
const GridKernels<double>& GridKernels<double>::best() {
    return HWY_DYNAMIC_DISPATCH(exactKernels)();
}
template <>
const GridKernels<float>& GridKernels<float>::best() {
    return HWY_DYNAMIC_DISPATCH(singleKernels)();
}
const FieldKernels& FieldKernels::best() { return HWY_DYNAMIC_DISPATCH(kernelsOfFields)(); }

}  // namespace RigidHIPlugin

#endif
