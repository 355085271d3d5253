// Random numbers as on the host (random/CounterNoise.h): Philox4x32-10, a function of seed, step,
// purpose, index and block.

DEVICE void philox(unsigned int* word, unsigned int key0, unsigned int key1) {
    for (int round = 0; round < 10; round++) {
        const mm_ulong product0 = (mm_ulong) 0xD2511F53u*word[0], product1 = (mm_ulong) 0xCD9E8D57u*word[2];
        word[0] = ((unsigned int) (product1 >> 32)) ^ word[1] ^ key0;
        word[2] = ((unsigned int) (product0 >> 32)) ^ word[3] ^ key1;
        word[1] = (unsigned int) product1;
        word[3] = (unsigned int) product0;
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
}

/** Uniform in [0, 1), 52 bits. */
DEVICE number uniformNumber(unsigned int low, unsigned int high) {
    const mm_ulong bits = ((((mm_ulong) high) << 32) | low) >> 12;
    return ((number) bits)*2.2204460492503131e-16;
}

DEVICE number discreteNumber(number u, int law) {
    const number root3 = 1.7320508075688772;
    if (law == TWO_POINT)
        return u < 0.5 ? -1.0 : 1.0;
    return u < 1.0/6.0 ? -root3 : u < 5.0/6.0 ? 0.0 : root3;
}

/** Two independent numbers of mean 0 and variance 1. */
DEVICE void noisePair(unsigned int seed, unsigned int stepLow, unsigned int stepHigh, unsigned int purpose, unsigned int index,
                      unsigned int block, int law, number* pair) {
    unsigned int word[4];
    word[0] = stepLow;
    word[1] = stepHigh;
    word[2] = index;
    word[3] = (purpose << 24) | block;
    philox(word, seed, NOISE_KEY);
    const number u = uniformNumber(word[0], word[1]), v = uniformNumber(word[2], word[3]);
    if (law == GAUSSIAN) {
        const number radius = sqrt(-2.0*log(1.0 - u));
        number sine, cosine;
        sineAndCosineOfTurns(v, &sine, &cosine);
        pair[0] = radius*cosine;
        pair[1] = radius*sine;
    }
    else {
        pair[0] = discreteNumber(u, law);
        pair[1] = discreteNumber(v, law);
    }
}
