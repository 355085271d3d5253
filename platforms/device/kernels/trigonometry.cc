// The sine and the cosine of an angle, which together take little longer than one of them.

DEVICE void sineAndCosine(number x, number* sine, number* cosine) {
#ifdef __OPENCL_VERSION__
    *sine = sincos(x, cosine);
#else
    sincos(x, sine, cosine);
#endif
}

/** Of an angle in turns. Where the language has a function for half turns, no angle needs reduction. */
DEVICE void sineAndCosineOfTurns(number turns, number* sine, number* cosine) {
#if defined(__CUDACC__) || defined(__HIP__) || defined(__HIPCC__)
    sincospi(2.0*turns, sine, cosine);
#else
    sineAndCosine(6.283185307179586*turns, sine, cosine);
#endif
}
