// The number type of the kernels of bodies, and operations of it.

typedef double number;

// Bodies have few threads, so that reads of a loop over sites should wait together.
#define UNROLL_SITES _Pragma("unroll 4")

// Sums and products that compilers do not fuse or reorder.
#ifdef __CUDACC__
DEVICE number exactSum(number a, number b) {
    return __dadd_rn(a, b);
}
DEVICE number exactProduct(number a, number b) {
    return __dmul_rn(a, b);
}
#else
#ifdef __OPENCL_VERSION__
#pragma OPENCL FP_CONTRACT OFF
#endif
DEVICE number exactSum(number a, number b) {
#ifndef __OPENCL_VERSION__
#pragma clang fp contract(off) reassociate(off)
#endif
    return a + b;
}
DEVICE number exactProduct(number a, number b) {
#ifndef __OPENCL_VERSION__
#pragma clang fp contract(off) reassociate(off)
#endif
    return a*b;
}
#ifdef __OPENCL_VERSION__
#pragma OPENCL FP_CONTRACT ON
#endif
#endif

/**
 * Whether a number is infinite or no number. Compilers may take a comparison away; and OpenMM has
 * HIP's compiler suppose that no sum is infinite, so that it must not know whence x comes.
 */
DEVICE bool isBad(number x) {
#ifdef __OPENCL_VERSION__
    const mm_long bits = as_long(x);
#elif defined(__CUDACC__)
    const mm_long bits = __double_as_longlong(x);
#else
    volatile number opaque = x;
    const mm_long bits = __double_as_longlong(opaque);
#endif
    return (bits & 0x7ff0000000000000L) == 0x7ff0000000000000L;
}

