#ifndef RIGIDHI_CPU_BODY_LOOPS_H_
#define RIGIDHI_CPU_BODY_LOOPS_H_

#include "host/StepSettings.h"
#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/** BodyLoops-inl.h with SIMD packs, for the best instruction set of this machine. */
LoopResult runSimdBodyLoop(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                           const ParticleArrays& arrays, int firstBlock, int endBlock);
void fillSimdNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                   double* xi);
/** The instruction set in use, such as "AVX3". */
const char* simdTargetName();
/** Number of doubles in a pack. */
int simdWidth();

}  // namespace RigidHIPlugin

#endif
