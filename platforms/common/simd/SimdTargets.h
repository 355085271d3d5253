#ifndef RIGIDHI_SIMD_TARGETS_H_
#define RIGIDHI_SIMD_TARGETS_H_

// On x86-64 four targets remain, with old and new versions of Highway: SSE4, AVX2 with FMA,
// AVX-512, and a fallback (scalar, or SSE2). A target with more instructions has a lower bit, so a
// mask of the lower bits also contains the targets that newer versions add (Zen 4, Sapphire Rapids,
// AVX10; on Arm bfloat16). Packs are members of structs, which SVE and RVV do not allow.
#define RIGIDHI_BEYOND_AVX3 (HWY_AVX3 - 1)
#define RIGIDHI_BEYOND_NEON (HWY_NEON - (2LL << HWY_HIGHEST_TARGET_BIT_X86))  // includes SVE
#ifdef RIGIDHI_FEW_SIMD_TARGETS  // sanitizer builds: instrumenting every set takes a quarter of an
                                 // hour to compile
#define HWY_DISABLED_TARGETS \
    (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3 | RIGIDHI_BEYOND_AVX3 | RIGIDHI_BEYOND_NEON | HWY_RVV)
#else
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | RIGIDHI_BEYOND_AVX3 | RIGIDHI_BEYOND_NEON | HWY_RVV)
#endif

#endif
