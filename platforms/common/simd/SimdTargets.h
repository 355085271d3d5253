#ifndef RIGIDHI_SIMD_TARGETS_H_
#define RIGIDHI_SIMD_TARGETS_H_

// On x86-64 these targets remain: scalar, SSE4, AVX2 with FMA, AVX-512. Packs are members of
// structs, which SVE and RVV do not allow.
#ifdef RIGIDHI_FEW_SIMD_TARGETS  // sanitizer builds: instrumenting every set takes a quarter of an
                                 // hour to compile
#define HWY_DISABLED_TARGETS                                                            \
    (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | \
     HWY_SVE2_128 | HWY_RVV)
#else
#define HWY_DISABLED_TARGETS \
    (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif

#endif
