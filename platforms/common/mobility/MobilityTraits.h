#ifndef RIGIDHI_MOBILITY_TRAITS_H_
#define RIGIDHI_MOBILITY_TRAITS_H_

namespace RigidHIPlugin {

/**
 * Properties of a model, for the constructor of MobilityModel. A model that wraps another one
 * copies the traits of the other and changes those that differ, so new traits need no extra line
 * there.
 */
struct MobilityTraits {
    explicit MobilityTraits(const char* name) : name(name) {}

    /** The name of the model in messages: that of setModel(). */
    const char* name;

    // ---- Where the model has a mobility
    /** Whether MobilityModel::objection() can ever refuse a placement. */
    bool mayObject = false;
    /**
     * Whether the formulas hold a little beyond what objection() allows, so that finite differences
     * work there.
     */
    bool holdsNearby = false;
    /**
     * Whether MobilityModel::near() keeps something from the previous placement, such as the grid
     * nodes within reach of a particle.
     */
    bool isAnchored = false;

    // ---- Symmetries
    /**
     * Whether a common shift of all particles leaves their mobility unchanged. Next to a wall it
     * does not.
     */
    bool isHomogeneous = false;
    /**
     * Whether the mobility rotates with the particles. Next to a wall and in a periodic box it does
     * not.
     */
    bool isIsotropic = false;
    /**
     * Whether the fluid is its own reflection at y = 0. Particles then have images there that are
     * not in the list of particles.
     */
    bool isMirrored = false;
    /**
     * Whether sum_j dM_ij/dx_j = 0 wherever the particles are. This holds where velocities are
     * averages of a divergence-free flow over spheres in a fluid without walls. Spheres and free
     * particles then have no stochastic drift.
     */
    bool isDivergenceFree = false;
    /** Whether particles resist strain by stresslets of their own. */
    bool hasStresslets = false;

    // ---- Cost
    /** Whether MobilityAt::multiply() needs no matrix, so that Krylov methods make sense. */
    bool hasProducts = true;
    /**
     * Whether each of these products needs iterations (MobilityAt::parts()). With
     * `slipsOfParts` such products serve only spheres about their centres, and nothing may be
     * fixed.
     */
    bool productsIterate = false;
    /**
     * Whether noise and differences of such a mobility are slips of its parts (NearAndFar), so that
     * one solve turns all of them into velocities. All particles are then spheres, and the far part
     * has rows of stresslets: five for each sphere, after all other rows.
     */
    bool slipsOfParts = false;
    /**
     * Whether products in single precision take less time than exact ones
     * (Accuracy::allowsSinglePrecision()), so that iterations should use them where their error is
     * small enough.
     */
    bool hasSinglePrecision = false;
    /**
     * Whether products in single precision are so fast that even a single product should use them
     * where its error may be that large. This is so where a device makes them.
     */
    bool hasFastSinglePrecision = false;
    /**
     * Whether MobilityAt::dense() makes products with the columns of the identity, so that it is
     * useful for few rows only.
     */
    bool isMatrixFree = false;
    /**
     * Whether MobilityAt::friction() costs less than dense(), so that callers who can use either
     * should ask for the friction.
     */
    bool isMadeFromFriction = false;
    /**
     * The number of rows of particles for each row of bodies above which the mobility of bodies
     * takes less time by iterations, column by column, than by a factor of dense(). The ratio of
     * both times is proportional to this number of rows. The value was measured on one thread with
     * shells of 642 blobs near a wall, at a tolerance of 1e-6.
     */
    double rowsWorthIterations = 1750;
};

}  // namespace RigidHIPlugin

#endif
