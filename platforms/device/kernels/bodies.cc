// Steps of rigid bodies and free particles. One thread does one body. The arithmetic of the scheme
// comes from the host's templates (SchemeText.h): the words in capitals between the loads and the
// stores are replaced by its text. State is in double precision, whatever the platform's is.

#define COLUMN(c) state[(c)*NUM_SLOTS + slot]
#define FACTOR(c) factors[(c)*NUM_SLOTS + slot]
#define LANES 8
#define SITE(s, c) sites[((s)*3 + (c))*LANES + lane]
#define IMAGE(s, c) images[((s)*3 + (c))*LANES + lane]

#define LOAD_POSE \
    number R_x = COLUMN(0), R_y = COLUMN(1), R_z = COLUMN(2); \
    number q_w = COLUMN(3), q_x = COLUMN(4), q_y = COLUMN(5), q_z = COLUMN(6);
#define LOAD_MOMENTA \
    number p_x = COLUMN(7), p_y = COLUMN(8), p_z = COLUMN(9); \
    number l_x = COLUMN(10), l_y = COLUMN(11), l_z = COLUMN(12); \
    const number inverseMass = FACTOR(0); \
    const number inverseMoment_x = FACTOR(1), inverseMoment_y = FACTOR(2), inverseMoment_z = FACTOR(3);
#define LOAD_FORCES \
    number force_x = COLUMN(13), force_y = COLUMN(14), force_z = COLUMN(15); \
    number torque_x = COLUMN(16), torque_y = COLUMN(17), torque_z = COLUMN(18);
#define STORE_POSE \
    COLUMN(0) = R_x; COLUMN(1) = R_y; COLUMN(2) = R_z; \
    COLUMN(3) = q_w; COLUMN(4) = q_x; COLUMN(5) = q_y; COLUMN(6) = q_z;
#define STORE_MOMENTA \
    COLUMN(7) = p_x; COLUMN(8) = p_y; COLUMN(9) = p_z; \
    COLUMN(10) = l_x; COLUMN(11) = l_y; COLUMN(12) = l_z;
#define STORE_FORCES \
    COLUMN(13) = force_x; COLUMN(14) = force_y; COLUMN(15) = force_z; \
    COLUMN(16) = torque_x; COLUMN(17) = torque_y; COLUMN(18) = torque_z;
#define LOAD_FACTORS \
    const number decay_p = FACTOR(4), noise_p = FACTOR(5), move_R = FACTOR(6), noise_R = FACTOR(7); \
    const number decay_l_x = FACTOR(8), decay_l_y = FACTOR(9), decay_l_z = FACTOR(10); \
    const number noise_l_x = FACTOR(11), noise_l_y = FACTOR(12), noise_l_z = FACTOR(13); \
    const number move_q_x = FACTOR(14), move_q_y = FACTOR(15), move_q_z = FACTOR(16); \
    const number noise_q_x = FACTOR(17), noise_q_y = FACTOR(18), noise_q_z = FACTOR(19);
#define DECLARE_NOISE \
    number xi1_x = 0, xi1_y = 0, xi1_z = 0, eta1_x = 0, eta1_y = 0, eta1_z = 0; \
    number xi2_x = 0, xi2_y = 0, xi2_z = 0, eta2_x = 0, eta2_y = 0, eta2_z = 0;
// The numbers of one draw; points have three, all other bodies six.
#define DRAW(xi, eta, purpose) { \
    number pair[2]; \
    noisePair(seed, stepLow, stepHigh, purpose, index, 0, law, pair); \
    xi##_x = pair[0]; xi##_y = pair[1]; \
    noisePair(seed, stepLow, stepHigh, purpose, index, 1, law, pair); \
    xi##_z = pair[0]; \
    if (kind == GENERAL || kind == LINEAR) { \
        eta##_x = pair[1]; \
        noisePair(seed, stepLow, stepHigh, purpose, index, 2, law, pair); \
        eta##_y = pair[0]; eta##_z = pair[1]; \
    } }
#define DRAW_FIRST DRAW(xi1, eta1, (kind == FREE ? FREE_FIRST_DRAW : FIRST_DRAW))
#define DRAW_SECOND DRAW(xi2, eta2, (kind == FREE ? FREE_SECOND_DRAW : SECOND_DRAW))

// A component of a site's place from the body's origin, in the lab frame, rounded in one way.
#define TURNED(axis) fma(A_##axis##x, site_x, fma(A_##axis##y, site_y, exactProduct(A_##axis##z, site_z)))
#define DECLARE_ROTATION \
    number A_xx, A_xy, A_xz, A_yx, A_yy, A_yz, A_zx, A_zy, A_zz; \
    ROTATION

DEVICE void readPosition(GLOBAL const real4* RESTRICT posq, GLOBAL const real4* RESTRICT posqCorrection, int place, number* position) {
    const real4 pos = posq[place];
    position[0] = pos.x;
    position[1] = pos.y;
    position[2] = pos.z;
#ifdef USE_MIXED_PRECISION
    const real4 correction = posqCorrection[place];
    position[0] += correction.x;
    position[1] += correction.y;
    position[2] += correction.z;
#endif
}

DEVICE void writePosition(GLOBAL real4* RESTRICT posq, GLOBAL real4* RESTRICT posqCorrection, int place, number x, number y, number z) {
    const real high_x = (real) x, high_y = (real) y, high_z = (real) z;
    // Not the whole of posq, because then its charge would have to be read.
    posq[place].x = high_x;
    posq[place].y = high_y;
    posq[place].z = high_z;
#ifdef USE_MIXED_PRECISION
    posqCorrection[place] = make_real4((real) (x - (number) high_x), (real) (y - (number) high_y), (real) (z - (number) high_z), 0);
#endif
}

// The velocity of site s as it is written to the particle.
#define SITE_VELOCITY \
    const number site_x = SITE(s, 0), site_y = SITE(s, 1), site_z = SITE(s, 2); \
    const number turn_x = omega_y*site_z - omega_z*site_y, turn_y = omega_z*site_x - omega_x*site_z, turn_z = omega_x*site_y - omega_y*site_x; \
    const mixed velocity_x = (mixed) (v_x + (A_xx*turn_x + A_xy*turn_y + A_xz*turn_z)); \
    const mixed velocity_y = (mixed) (v_y + (A_yx*turn_x + A_yy*turn_y + A_yz*turn_z)); \
    const mixed velocity_z = (mixed) (v_z + (A_zx*turn_x + A_zy*turn_y + A_zz*turn_z));
#define DECLARE_TWIST \
    const number omega_x = l_x*inverseMoment_x, omega_y = l_y*inverseMoment_y, omega_z = l_z*inverseMoment_z; \
    const number v_x = kind == FREE ? p_x : inverseMass*p_x, v_y = kind == FREE ? p_y : inverseMass*p_y, v_z = kind == FREE ? p_z : inverseMass*p_z;

#define WRITE_VELOCITIES \
    UNROLL_SITES \
    for (int s = block.y; s < block.y + block.z; s++) { \
        const int place = sitePlace[s*LANES + lane]; \
        SITE_VELOCITY \
        if (place >= 0) { \
            velm[place].x = velocity_x; \
            velm[place].y = velocity_y; \
            velm[place].z = velocity_z; \
        } \
    }

/** The place in posq of each particle, from the particle of each place. */
KERNEL void findPlaces(GLOBAL const int* RESTRICT particleOfPlace, GLOBAL int* RESTRICT placeOf) {
    for (int i = GLOBAL_ID; i < NUM_PARTICLES; i += GLOBAL_SIZE)
        placeOf[particleOfPlace[i]] = i;
}

/**
 * The place of the particle of each site, and of those that get forces; -1 where there is none. Every
 * step reads places, and two reads that wait for each other would take twice as long.
 */
KERNEL void findPlacesOfSites(GLOBAL const int* RESTRICT placeOf, GLOBAL const int* RESTRICT siteParticle, GLOBAL const int* RESTRICT forceParticle,
        GLOBAL int* RESTRICT sitePlace, GLOBAL int* RESTRICT forcePlace, int numEntries) {
    for (int i = GLOBAL_ID; i < numEntries; i += GLOBAL_SIZE) {
        sitePlace[i] = siteParticle[i] < 0 ? -1 : placeOf[siteParticle[i]];
        forcePlace[i] = forceParticle[i] < 0 ? -1 : placeOf[forceParticle[i]];
    }
}

/**
 * Compare positions with those of the bodies, and find the lattice vectors between them.
 *
 * @param moves  whether bodies may have moved as a whole, by less than half a box
 */
KERNEL void takeInPositions(GLOBAL number* RESTRICT state, GLOBAL const int4* RESTRICT blocks, GLOBAL const int* RESTRICT noiseIndex,
        GLOBAL const number* RESTRICT sites, GLOBAL const int* RESTRICT sitePlace, GLOBAL const int* RESTRICT forcePlace,
        GLOBAL int* RESTRICT images, GLOBAL const real4* RESTRICT posq,
        GLOBAL const real4* RESTRICT posqCorrection, GLOBAL int* RESTRICT flags, int moves, number rounding, number beside,
        number a_x, number b_x, number b_y, number c_x, number c_y, number c_z) {
    if (flags[0] | flags[1])
        return;
    for (int slot = GLOBAL_ID; slot < NUM_SLOTS; slot += GLOBAL_SIZE) {
        if (noiseIndex[slot] < 0)
            continue;
        const int4 block = blocks[slot/LANES];
        const int lane = slot%LANES;
        LOAD_POSE
        DECLARE_ROTATION
        number mean[3] = {0, 0, 0}, least[3] = {0, 0, 0}, most[3] = {0, 0, 0}, largest = beside;
        int count = 0;
        for (int s = block.y; s < block.y + block.z; s++) {
            const int particlePlace = sitePlace[s*LANES + lane];
            if (particlePlace < 0)
                continue;
            const number site_x = SITE(s, 0), site_y = SITE(s, 1), site_z = SITE(s, 2);
            number position[3];
            readPosition(posq, posqCorrection, particlePlace, position);
            const number place[3] = {R_x + TURNED(x), R_y + TURNED(y), R_z + TURNED(z)};
            number d[3];
            for (int c = 0; c < 3; c++) {
                d[c] = position[c] - place[c];
                largest = fmax(largest, fabs(position[c]) + fabs(place[c]));
            }
#ifdef PERIODIC
            const int n_z = (int) floor(d[2]/c_z + 0.5);
            const int n_y = (int) floor((d[1] - n_z*c_y)/b_y + 0.5);
            const int n_x = (int) floor((d[0] - n_z*c_x - n_y*b_x)/a_x + 0.5);
            IMAGE(s, 0) = n_x;
            IMAGE(s, 1) = n_y;
            IMAGE(s, 2) = n_z;
            d[0] -= n_x*a_x + n_y*b_x + n_z*c_x;
            d[1] -= n_y*b_y + n_z*c_y;
            d[2] -= n_z*c_z;
#endif
            if (forcePlace[s*LANES + lane] < 0)
                continue;  // a virtual site follows its parents
            for (int c = 0; c < 3; c++) {
                mean[c] += d[c];
                least[c] = count == 0 ? d[c] : fmin(least[c], d[c]);
                most[c] = count == 0 ? d[c] : fmax(most[c], d[c]);
            }
            count++;
        }
        const number tolerance = rounding*largest;
        bool fits = true;
        for (int c = 0; c < 3; c++) {
            if (moves)
                fits = fits && most[c] - least[c] <= 2*tolerance;
            else
                fits = fits && most[c] <= tolerance && least[c] >= -tolerance;
            fits = fits && !isBad(mean[c]);
        }
        if (!fits)
            flags[1] = 1;
        else if (moves && count > 0 && block.x != HELD) {
            COLUMN(0) = R_x + mean[0]/count;
            COLUMN(1) = R_y + mean[1]/count;
            COLUMN(2) = R_z + mean[2]/count;
        }
        else if (moves && (fabs(mean[0]) + fabs(mean[1]) + fabs(mean[2]) > count*tolerance))
            flags[1] = 1;
    }
}

// Positions of all particles of a body.
#define WRITE_POSITIONS \
    UNROLL_SITES \
    for (int s = block.y; s < block.y + block.z; s++) { \
        const int place = sitePlace[s*LANES + lane]; \
        const number site_x = SITE(s, 0), site_y = SITE(s, 1), site_z = SITE(s, 2); \
        number x = R_x + TURNED(x), y = R_y + TURNED(y), z = R_z + TURNED(z); \
        TO_IMAGE \
        if (place >= 0) \
            writePosition(posq, posqCorrection, place, x, y, z); \
    }
#ifdef PERIODIC
#define TO_IMAGE \
    const int n_x = IMAGE(s, 0), n_y = IMAGE(s, 1), n_z = IMAGE(s, 2); \
    x += exactSum(exactSum(exactProduct(n_x, a_x), exactProduct(n_y, b_x)), exactProduct(n_z, c_x)); \
    y += exactSum(exactProduct(n_y, b_y), exactProduct(n_z, c_y)); \
    z += exactProduct(n_z, c_z);
#else
#define TO_IMAGE
#endif

/** New positions of the particles. */
KERNEL void writePositions(GLOBAL number* RESTRICT state, GLOBAL const int4* RESTRICT blocks, GLOBAL const int* RESTRICT noiseIndex,
        GLOBAL const number* RESTRICT sites, GLOBAL const int* RESTRICT sitePlace, GLOBAL const int* RESTRICT images,
        GLOBAL real4* RESTRICT posq, GLOBAL real4* RESTRICT posqCorrection,
        GLOBAL const int* RESTRICT flags, number a_x, number b_x, number b_y, number c_x, number c_y, number c_z) {
    if (flags[0] | flags[1])
        return;
    for (int slot = GLOBAL_ID; slot < NUM_SLOTS; slot += GLOBAL_SIZE) {
        if (noiseIndex[slot] < 0)
            continue;
        const int4 block = blocks[slot/LANES];
        const int lane = slot%LANES;
        if (block.x == HELD)
            continue;  // they stay where they are, to the last bit
        LOAD_POSE
        DECLARE_ROTATION
        WRITE_POSITIONS
    }
}

// Add up what the threads of a group have put into `parts`, so many numbers of each thread.
#define ADD_PARTS(count, result) \
    SYNC_THREADS; \
    for (int width = SUM_THREADS/2; width > 0; width /= 2) { \
        if (LOCAL_ID < width) \
            for (int k = 0; k < count; k++) \
                parts[k*SUM_THREADS + LOCAL_ID] += parts[k*SUM_THREADS + LOCAL_ID + width]; \
        SYNC_THREADS; \
    } \
    if (LOCAL_ID == 0) \
        for (int k = 0; k < count; k++) \
            result[k] = parts[k*SUM_THREADS];

/**
 * Parts of the momentum of all bodies and free particles, and their sum. Which bodies a part has does
 * not depend on the device.
 */
KERNEL void sumMomenta(GLOBAL const number* RESTRICT state, GLOBAL const number* RESTRICT factors, GLOBAL const int4* RESTRICT blocks,
        GLOBAL const int* RESTRICT noiseIndex, GLOBAL number* RESTRICT momentumParts) {
    for (int part = GLOBAL_ID; part < MOMENTUM_PARTS; part += GLOBAL_SIZE) {
        number sum[3] = {0, 0, 0};
        for (int slot = part; slot < NUM_SLOTS; slot += MOMENTUM_PARTS) {
            const int kind = blocks[slot/LANES].x;
            if (noiseIndex[slot] < 0 || kind == HELD || !(FACTOR(0) > 0))
                continue;
            const number mass = kind == FREE ? 1/FACTOR(0) : 1;
            for (int c = 0; c < 3; c++)
                sum[c] += mass*COLUMN(7 + c);
        }
        for (int c = 0; c < 3; c++)
            momentumParts[c*MOMENTUM_PARTS + part] = sum[c];
    }
}
KERNEL void addMomenta(GLOBAL const number* RESTRICT momentumParts, GLOBAL number* RESTRICT momentum) {
    LOCAL number parts[3*SUM_THREADS];
    for (int c = 0; c < 3; c++) {
        number sum = 0;
        for (int part = LOCAL_ID; part < MOMENTUM_PARTS; part += SUM_THREADS)
            sum += momentumParts[c*MOMENTUM_PARTS + part];
        parts[c*SUM_THREADS + LOCAL_ID] = sum;
    }
    ADD_PARTS(3, momentum)
}

/** The scheme up to the evaluation of forces: new poses, new positions of the particles. */
KERNEL void beforeForces(GLOBAL number* RESTRICT state, GLOBAL const number* RESTRICT factors, GLOBAL const int4* RESTRICT blocks,
        GLOBAL const int* RESTRICT noiseIndex, GLOBAL const number* RESTRICT sites, GLOBAL const int* RESTRICT sitePlace,
        GLOBAL const int* RESTRICT images,
        GLOBAL real4* RESTRICT posq, GLOBAL real4* RESTRICT posqCorrection, GLOBAL const number* RESTRICT momentum, GLOBAL int* RESTRICT flags,
        number h, unsigned int seed, unsigned int stepLow, unsigned int stepHigh, int law, int hasNoise, int removesMomentum,
        number totalMass, number a_x, number b_x, number b_y, number c_x, number c_y, number c_z) {
    const bool isStopped = flags[0] | flags[1];
    for (int slot = GLOBAL_ID; slot < NUM_SLOTS; slot += GLOBAL_SIZE) {
        // All numbers are read before the first branch, so that reads wait together.
        const int index = noiseIndex[slot];
        const int4 block = blocks[slot/LANES];
        const int lane = slot%LANES, kind = block.x;
        LOAD_POSE
        LOAD_MOMENTA
        LOAD_FORCES
        LOAD_FACTORS
        if (isStopped || index < 0 || kind == HELD)
            continue;
        if (removesMomentum && inverseMass > 0) {
            const number mass = kind == FREE ? 1 : 1/inverseMass;
            p_x -= mass*(momentum[0]/totalMass);
            p_y -= mass*(momentum[1]/totalMass);
            p_z -= mass*(momentum[2]/totalMass);
        }
        DECLARE_NOISE
        if (hasNoise) {
#ifdef BEFORE_DRAWS_FIRST
            DRAW_FIRST
#endif
#ifdef BEFORE_DRAWS_SECOND
            DRAW_SECOND
#endif
        }
        if (kind == GENERAL)
            BEFORE_GENERAL
        else if (kind == LINEAR)
            BEFORE_LINEAR
        else if (kind == POINT)
            BEFORE_POINT
#ifndef CONSTRAINED
        else
            BEFORE_FREE
#endif
        if (isBad(R_x + R_y + R_z + q_w + q_x + q_y + q_z)) {
            flags[0] = 1;
            continue;
        }
        STORE_POSE
        STORE_MOMENTA
        DECLARE_ROTATION
        WRITE_POSITIONS
    }
}

// The moves of free particles with constraints, one by one. OpenMM's constraints act in between, on
// its own arrays: on the displacements of a drift, and on velocities.

#ifdef CONSTRAINED
/** @param move  KICK, DRIFT, DAMP, or NOISE; a drift only says how far particles are to move */
KERNEL void moveFree(GLOBAL number* RESTRICT state, GLOBAL const number* RESTRICT factors, GLOBAL const int4* RESTRICT blocks,
        GLOBAL const int* RESTRICT noiseIndex, GLOBAL const int* RESTRICT sitePlace,
        GLOBAL mixed4* RESTRICT velm, GLOBAL mixed4* RESTRICT posDelta, GLOBAL const int* RESTRICT flags, int move, number t,
        unsigned int purpose, unsigned int seed, unsigned int stepLow, unsigned int stepHigh, int law) {
    if (flags[0] | flags[1])
        return;
    for (int slot = NUM_BODY_SLOTS + GLOBAL_ID; slot < NUM_SLOTS; slot += GLOBAL_SIZE) {
        const int index = noiseIndex[slot];
        const int4 block = blocks[slot/LANES];
        if (index < 0 || block.x != FREE)
            continue;
        const int place = sitePlace[block.y*LANES + slot%LANES];
        number R_x = COLUMN(0), R_y = COLUMN(1), R_z = COLUMN(2), p_x = COLUMN(7), p_y = COLUMN(8), p_z = COLUMN(9);
        const number force_x = COLUMN(13), force_y = COLUMN(14), force_z = COLUMN(15);
        const number inverseMass = FACTOR(0), decay_p = FACTOR(4), noise_p = FACTOR(5);
        if (move == DRIFT) {
            FREE_DRIFT
            const number d_x = R_x - COLUMN(0), d_y = R_y - COLUMN(1), d_z = R_z - COLUMN(2);
            posDelta[place] = make_mixed4((mixed) d_x, (mixed) d_y, (mixed) d_z, 0);
            continue;
        }
        if (move == KICK)
            FREE_KICK
        else if (move == DAMP)
            FREE_DAMP
        else {
            number xi1_x, xi1_y, xi1_z, pair[2];
            noisePair(seed, stepLow, stepHigh, purpose, index, 0, law, pair);
            xi1_x = pair[0];
            xi1_y = pair[1];
            noisePair(seed, stepLow, stepHigh, purpose, index, 1, law, pair);
            xi1_z = pair[0];
            FREE_NOISE
        }
        COLUMN(7) = p_x;
        COLUMN(8) = p_y;
        COLUMN(9) = p_z;
        velm[place].x = (mixed) p_x;
        velm[place].y = (mixed) p_y;
        velm[place].z = (mixed) p_z;
    }
}

/** The end of a drift over the time t: displacements are those that the constraints allow. */
KERNEL void endDriftOfFree(GLOBAL number* RESTRICT state, GLOBAL const int4* RESTRICT blocks, GLOBAL const int* RESTRICT noiseIndex,
        GLOBAL const int* RESTRICT sitePlace, GLOBAL const int* RESTRICT images,
        GLOBAL real4* RESTRICT posq, GLOBAL real4* RESTRICT posqCorrection, GLOBAL mixed4* RESTRICT velm,
        GLOBAL const mixed4* RESTRICT posDelta, GLOBAL int* RESTRICT flags, number t,
        number a_x, number b_x, number b_y, number c_x, number c_y, number c_z) {
    if (flags[0] | flags[1])
        return;
    for (int slot = NUM_BODY_SLOTS + GLOBAL_ID; slot < NUM_SLOTS; slot += GLOBAL_SIZE) {
        const int4 block = blocks[slot/LANES];
        if (noiseIndex[slot] < 0 || block.x != FREE)
            continue;
        const int lane = slot%LANES, s = block.y, place = sitePlace[s*LANES + lane];
        const number R_x = COLUMN(0), R_y = COLUMN(1), R_z = COLUMN(2), p_x = COLUMN(7), p_y = COLUMN(8), p_z = COLUMN(9);
        const mixed4 d = posDelta[place];
        number x = R_x + d.x, y = R_y + d.y, z = R_z + d.z;
        // What the constraints have added, without the rounding of the displacement itself.
        const number v_x = p_x + ((number) d.x - (number) (mixed) (p_x*t))/t, v_y = p_y + ((number) d.y - (number) (mixed) (p_y*t))/t,
                     v_z = p_z + ((number) d.z - (number) (mixed) (p_z*t))/t;
        if (isBad(x + y + z + v_x + v_y + v_z)) {
            flags[0] = 1;
            continue;
        }
        COLUMN(0) = x;
        COLUMN(1) = y;
        COLUMN(2) = z;
        COLUMN(7) = v_x;
        COLUMN(8) = v_y;
        COLUMN(9) = v_z;
        TO_IMAGE
        writePosition(posq, posqCorrection, place, x, y, z);
        velm[place].x = (mixed) v_x;
        velm[place].y = (mixed) v_y;
        velm[place].z = (mixed) v_z;
    }
}

#endif

/**
 * The velocity p with what others have changed since (mixed) p was written and `now` is there. It
 * keeps its digits beyond those of `now`, unless another call would then find a change.
 */
DEVICE number changedVelocity(number p, mixed now) {
    const number changed = p + ((number) now - (number) (mixed) p);
    return (mixed) changed == now ? changed : (number) now;
}

/**
 * What others, or OpenMM's constraints, have changed in the velocities that were written. OpenMM does
 * not tell of it. Velocities of bodies fit constraints already.
 */
KERNEL void takeInVelocitiesOfFree(GLOBAL number* RESTRICT state, GLOBAL const int4* RESTRICT blocks, GLOBAL const int* RESTRICT noiseIndex,
        GLOBAL const int* RESTRICT sitePlace, GLOBAL const mixed4* RESTRICT velm,
        GLOBAL int* RESTRICT flags) {
    if (flags[0] | flags[1])
        return;
    for (int slot = NUM_BODY_SLOTS + GLOBAL_ID; slot < NUM_SLOTS; slot += GLOBAL_SIZE) {
        const int4 block = blocks[slot/LANES];
        if (noiseIndex[slot] < 0 || block.x != FREE)
            continue;
        const mixed4 now = velm[sitePlace[block.y*LANES + slot%LANES]];
        const number v_x = changedVelocity(COLUMN(7), now.x), v_y = changedVelocity(COLUMN(8), now.y),
                     v_z = changedVelocity(COLUMN(9), now.z);
        if (isBad(v_x + v_y + v_z))
            flags[0] = 1;
        COLUMN(7) = v_x;
        COLUMN(8) = v_y;
        COLUMN(9) = v_z;
    }
}

/**
 * Forces from the particles; the rest of the scheme; new velocities of the particles.
 *
 * @param onlyGathers  only the forces are wanted
 */
KERNEL void afterForces(GLOBAL number* RESTRICT state, GLOBAL const number* RESTRICT factors, GLOBAL const int4* RESTRICT blocks,
        GLOBAL const int* RESTRICT noiseIndex, GLOBAL const number* RESTRICT sites, GLOBAL const int* RESTRICT sitePlace,
        GLOBAL const int* RESTRICT forcePlace, GLOBAL mixed4* RESTRICT velm,
        GLOBAL const mm_long* RESTRICT forces, GLOBAL int* RESTRICT flags, number h, unsigned int seed, unsigned int stepLow,
        unsigned int stepHigh, int law, int hasNoise, int onlyGathers) {
    const bool isStopped = flags[0] | flags[1];
    const number unit = 1.0/4294967296.0, largestForce = LARGEST_FORCE;
    for (int slot = GLOBAL_ID; slot < NUM_SLOTS; slot += GLOBAL_SIZE) {
        const int index = noiseIndex[slot];
        const int4 block = blocks[slot/LANES];
        const int lane = slot%LANES, kind = block.x;
        LOAD_POSE
        LOAD_MOMENTA
        LOAD_FACTORS
        if (isStopped || index < 0)
            continue;
        DECLARE_ROTATION
        number force_x = 0, force_y = 0, force_z = 0, torque_x = 0, torque_y = 0, torque_z = 0;
        bool bad = false;
        UNROLL_SITES
        for (int s = block.y; s < block.y + block.z; s++) {
            const int forcePlaceOrNone = forcePlace[s*LANES + lane], place = forcePlaceOrNone < 0 ? 0 : forcePlaceOrNone;
            const number ofPlace = forcePlaceOrNone < 0 ? 0 : unit;
            const number f_x = ofPlace*forces[place], f_y = ofPlace*forces[place + PADDED_PARTICLES], f_z = ofPlace*forces[place + 2*PADDED_PARTICLES];
            bad = bad || !(fabs(f_x) < largestForce && fabs(f_y) < largestForce && fabs(f_z) < largestForce);
            force_x += f_x;
            force_y += f_y;
            force_z += f_z;
            const number site_x = SITE(s, 0), site_y = SITE(s, 1), site_z = SITE(s, 2);
            const number arm_x = TURNED(x), arm_y = TURNED(y), arm_z = TURNED(z);
            torque_x += arm_y*f_z - arm_z*f_y;
            torque_y += arm_z*f_x - arm_x*f_z;
            torque_z += arm_x*f_y - arm_y*f_x;
        }
        const number lab_x = torque_x, lab_y = torque_y, lab_z = torque_z;
        torque_x = A_xx*lab_x + A_yx*lab_y + A_zx*lab_z;
        torque_y = A_xy*lab_x + A_yy*lab_y + A_zy*lab_z;
        torque_z = A_xz*lab_x + A_yz*lab_y + A_zz*lab_z;
        STORE_FORCES
        if (onlyGathers) {
            if (bad)
                flags[0] = 1;
            continue;
        }
        if (kind != HELD) {
            DECLARE_NOISE
            if (hasNoise) {
#ifdef AFTER_DRAWS_FIRST
                DRAW_FIRST
#endif
#ifdef AFTER_DRAWS_SECOND
                DRAW_SECOND
#endif
            }
            if (kind == GENERAL)
                AFTER_GENERAL
            else if (kind == LINEAR)
                AFTER_LINEAR
            else if (kind == POINT)
                AFTER_POINT
#ifndef CONSTRAINED
            else
                AFTER_FREE
#endif
        }
        if (bad || isBad(p_x + p_y + p_z + l_x + l_y + l_z)) {
            flags[0] = 1;
            continue;
        }
        STORE_MOMENTA
#ifdef HAS_MOMENTA
        DECLARE_TWIST
        WRITE_VELOCITIES
#endif
    }
}

#ifdef CONSTRAINED
/**
 * Velocities of the particles of bodies, after OpenMM's constraints have acted on all particles. They
 * would round velocities of bodies, and make NaN where constraints of a body are redundant.
 */
KERNEL void writeVelocitiesOfBodies(GLOBAL const number* RESTRICT state, GLOBAL const number* RESTRICT factors, GLOBAL const int4* RESTRICT blocks,
        GLOBAL const int* RESTRICT noiseIndex, GLOBAL const number* RESTRICT sites, GLOBAL const int* RESTRICT sitePlace,
        GLOBAL mixed4* RESTRICT velm, GLOBAL const int* RESTRICT flags) {
    if (flags[0] | flags[1])
        return;
    for (int slot = GLOBAL_ID; slot < NUM_BODY_SLOTS; slot += GLOBAL_SIZE) {
        if (noiseIndex[slot] < 0)
            continue;
        const int4 block = blocks[slot/LANES];
        const int lane = slot%LANES, kind = block.x;
        LOAD_POSE
        LOAD_MOMENTA
        DECLARE_ROTATION
        DECLARE_TWIST
        WRITE_VELOCITIES
    }
}
#endif

/**
 * Add the kinetic energies of mid-step momenta (host/MidStep.h) to `sums`: twice the translational
 * energy, twice the rotational one, and the momentum. One group of threads does all, so that the
 * sums do not depend on the device.
 *
 * @param means  the factors of momentum and force for p and the three components of l
 */
KERNEL void addEnergies(GLOBAL const number* RESTRICT state, GLOBAL const number* RESTRICT factors, GLOBAL const number* RESTRICT means,
        GLOBAL const int4* RESTRICT blocks, GLOBAL const int* RESTRICT noiseIndex, GLOBAL number* RESTRICT sums) {
    LOCAL number parts[5*SUM_THREADS];
    number own[5] = {0, 0, 0, 0, 0};
    for (int slot = LOCAL_ID; slot < NUM_BODY_SLOTS; slot += SUM_THREADS) {
        if (noiseIndex[slot] < 0 || blocks[slot/LANES].x == HELD)
            continue;
        const number factor = means[slot], time = means[NUM_SLOTS + slot];
        for (int c = 0; c < 3; c++) {
            const number p = factor*COLUMN(7 + c) + time*COLUMN(13 + c);
            own[0] += FACTOR(0)*p*p;
            own[2 + c] += p;
            const number l = means[(2 + 2*c)*NUM_SLOTS + slot]*COLUMN(10 + c) + means[(3 + 2*c)*NUM_SLOTS + slot]*COLUMN(16 + c);
            own[1] += FACTOR(1 + c)*l*l;
        }
    }
    for (int k = 0; k < 5; k++)
        parts[k*SUM_THREADS + LOCAL_ID] = own[k];
    ADD_PARTS(5, sums)
}
