// Products with the Rotne-Prager-Yamakawa mobility, in unbounded fluid or above a no-slip wall: the sum over all pairs, in floats.
// One thread does one target i. Sources j are taken in tiles, and the sum of a tile is added to doubles. The formulas of a pair come from the
// host's templates (PairText.h): the words in capitals are replaced by their text. The mobility of a sphere in itself is not part of the
// sum, but what the wall adds to it is.

#ifdef HAS_TORQUE
#define NUM_COMPONENTS 6
#else
#define NUM_COMPONENTS 3
#endif

/** The difference of two positions, each of which is the sum of two floats. Compilers that reorder sums would lose the small parts. */
DEVICE float difference(float high_i, float low_i, float high_j, float low_j) {
#if defined(__HIP__) || defined(__HIPCC__)
#pragma clang fp reassociate(off)
#endif
    return (high_i - high_j) + (low_i - low_j);
}

/**
 * Sums over chunks of sources. Work is divided by the number of particles alone, so that sums do not depend on the device.
 *
 * @param places       x, y, z (from the wall, if there is one) and the radius
 * @param remainders   what places lack of x, y, z
 * @param forces       of column after column; no torques without HAS_TORQUE
 * @param partialSums  row (chunk numColumns + column) NUM_COMPONENTS + k has a component of all particles
 */
KERNEL void addPairs(GLOBAL const float4* RESTRICT places, GLOBAL const float4* RESTRICT remainders, GLOBAL const float4* RESTRICT forces,
        GLOBAL const float4* RESTRICT torques, GLOBAL double* RESTRICT partialSums, int numParticles, int numColumns, int numChunks,
        int sourcesOfChunk) {
    LOCAL float4 sourcePlaces[TILE];
    LOCAL float4 sourceRemainders[TILE];
    LOCAL float4 sourceForces[TILE];
#ifdef HAS_TORQUE
    LOCAL float4 sourceTorques[TILE];
#endif
    const int numBlocks = (numParticles + GROUP - 1)/GROUP, numItems = numBlocks*numChunks*numColumns;
    // There may be fewer groups than items.
    for (int item = GROUP_ID; item < numItems; item += NUM_GROUPS) {
        const int block = item%numBlocks, row = item/numBlocks, column = row%numColumns, chunk = row/numColumns;
        const int own = block*GROUP + LOCAL_ID, i = own < numParticles ? own : numParticles - 1;
        const float4 place_i = places[i], remainder_i = remainders[i];
        const float a_i = place_i.w;
        const int firstSource = chunk*sourcesOfChunk,
                  endSource = numParticles < firstSource + sourcesOfChunk ? numParticles : firstSource + sourcesOfChunk;
        double sumV_x = 0, sumV_y = 0, sumV_z = 0;
#ifdef HAS_TORQUE
        double sumW_x = 0, sumW_y = 0, sumW_z = 0;
#endif
        for (int first = firstSource; first < endSource; first += TILE) {
            const int count = endSource - first < TILE ? endSource - first : TILE;
            SYNC_THREADS;
            if (LOCAL_ID < count) {
                sourcePlaces[LOCAL_ID] = places[first + LOCAL_ID];
                sourceRemainders[LOCAL_ID] = remainders[first + LOCAL_ID];
                sourceForces[LOCAL_ID] = forces[column*numParticles + first + LOCAL_ID];
#ifdef HAS_TORQUE
                sourceTorques[LOCAL_ID] = torques[column*numParticles + first + LOCAL_ID];
#endif
            }
            SYNC_THREADS;
            // Few numbers are added one by one, and these sums are added then, so that fewer roundings add up.
            float tileV_x = 0, tileV_y = 0, tileV_z = 0;
#ifdef HAS_TORQUE
            float tileW_x = 0, tileW_y = 0, tileW_z = 0;
#endif
            for (int part = 0; part < count; part += PART) {
                const int endPart = count < part + PART ? count : part + PART;
                float V_x = 0, V_y = 0, V_z = 0;
#ifdef HAS_TORQUE
                float W_x = 0, W_y = 0, W_z = 0;
#endif
                for (int s = part; s < endPart; s++) {
                    const float4 place_j = sourcePlaces[s], remainder_j = sourceRemainders[s], force = sourceForces[s];
                    const float a_j = place_j.w;
                    const float r_x = difference(place_i.x, remainder_i.x, place_j.x, remainder_j.x);
                    const float r_y = difference(place_i.y, remainder_i.y, place_j.y, remainder_j.y);
                    const float r_z = difference(place_i.z, remainder_i.z, place_j.z, remainder_j.z);
                    const float F_x = force.x, F_y = force.y, F_z = force.z;
#ifdef HAS_TORQUE
                    const float4 torque = sourceTorques[s];
                    const float T_x = torque.x, T_y = torque.y, T_z = torque.z;
#endif
                    float compared, bound;
                    COMPARISON
                    float m_ttI = 0, m_ttR = 0;
#ifdef HAS_TORQUE
                    float m_tr = 0, m_rt = 0, m_rrI = 0, m_rrR = 0;
#endif
                    if (compared > bound)
                        FACTORS_APART
                    else if (first + s != i)
                        FACTORS_OVERLAPPING
                    PAIR_VELOCITIES
#ifdef HAS_WALL
                    const float z_i = place_i.z, z_j = place_j.z;
                    WALL_VELOCITIES
#endif
                }
                tileV_x += V_x;
                tileV_y += V_y;
                tileV_z += V_z;
#ifdef HAS_TORQUE
                tileW_x += W_x;
                tileW_y += W_y;
                tileW_z += W_z;
#endif
            }
            sumV_x += tileV_x;
            sumV_y += tileV_y;
            sumV_z += tileV_z;
#ifdef HAS_TORQUE
            sumW_x += tileW_x;
            sumW_y += tileW_y;
            sumW_z += tileW_z;
#endif
        }
        if (own < numParticles) {
            GLOBAL double* sums = partialSums + row*NUM_COMPONENTS*numParticles + own;
            sums[0] = sumV_x;
            sums[numParticles] = sumV_y;
            sums[2*numParticles] = sumV_z;
#ifdef HAS_TORQUE
            sums[3*numParticles] = sumW_x;
            sums[4*numParticles] = sumW_y;
            sums[5*numParticles] = sumW_z;
#endif
        }
    }
}

/** The sums of chunks, always in the same order. */
KERNEL void addChunks(GLOBAL const double* RESTRICT partialSums, GLOBAL double* RESTRICT sums, int numSums, int numChunks) {
    for (int i = GLOBAL_ID; i < numSums; i += GLOBAL_SIZE) {
        double sum = 0;
        for (int chunk = 0; chunk < numChunks; chunk++)
            sum += partialSums[chunk*numSums + i];
        sums[i] = sum;
    }
}
