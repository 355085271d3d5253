// The loops over bodies, compiled once for each instruction set. Highway chooses the best one at
// run time.

#include "simd/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "host/SimdBodyLoops.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "host/SimdBodyLoops.h"
#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

HWY_BEFORE_NAMESPACE();
#include "host/BodyLoops-inl.h"
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

LoopResult runPackLoop(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                       const ParticleArrays& arrays, int firstBlock, int endBlock) {
    return runBodyLoop<Pack>(loop, bodies, settings, arrays, firstBlock, endBlock);
}
void fillPackNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                   double* xi) {
    fillNoise<Pack>(noise, purpose, index, count, xi);
}
const char* targetName() { return hwy::TargetName(HWY_TARGET); }
int packWidth() { return lanes(Pack(0.0)); }

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(runPackLoop);
HWY_EXPORT(fillPackNoise);
HWY_EXPORT(targetName);
HWY_EXPORT(packWidth);

LoopResult runSimdBodyLoop(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                           const ParticleArrays& arrays, int firstBlock, int endBlock) {
    return HWY_DYNAMIC_DISPATCH(runPackLoop)(loop, bodies, settings, arrays, firstBlock, endBlock);
}
void fillSimdNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                   double* xi) {
    HWY_DYNAMIC_DISPATCH(fillPackNoise)(noise, purpose, index, count, xi);
}
const char* simdTargetName() { return HWY_DYNAMIC_DISPATCH(targetName)(); }
int simdWidth() { return HWY_DYNAMIC_DISPATCH(packWidth)(); }

}  // namespace RigidHIPlugin

#endif
