#ifndef RIGIDHI_MOBILITY_TRAITS_H_
#define RIGIDHI_MOBILITY_TRAITS_H_

namespace RigidHIPlugin {

/**
 * What a model says about itself, given to the constructor of MobilityModel. A model that is made
 * from another one copies the traits of the other and changes what is different, so that it hands
 * on a new trait without a line of its own.
 */
struct MobilityTraits {
    explicit MobilityTraits(const char* name) : name(name) {}

    /** The name of the model in messages: that of setModel(). */
    const char* name;

    // ---- Where the model has a mobility
    /** Whether MobilityModel::objection() can ever refuse a placement. */
    bool mayObject = false;
    /**
     * Whether the formulas hold a little beyond what objection() allows, as finite differences from
     * there need.
     */
    bool holdsNearby = false;
    /**
     * Whether MobilityModel::near() keeps something of the placement before, such as the nodes of a
     * grid that a particle reaches.
     */
    bool isAnchored = false;

    // ---- Symmetries
    /**
     * Whether the mobility of particles stays the same when all are shifted alike, which is not so
     * next to a wall.
     */
    bool isHomogeneous = false;
    /**
     * Whether the mobility turns with the particles, which is so neither next to a wall nor in a
     * periodic box.
     */
    bool isIsotropic = false;
    /**
     * Whether the fluid is its own reflection at y = 0. Particles then have images there that are
     * not in the list of particles.
     */
    bool isMirrored = false;
    /**
     * Whether sum_j dM_ij/dx_j = 0 wherever the particles are. So it is where velocities are
     * averages of a divergence-free flow over spheres in a fluid without walls. Spheres and free
     * particles then have no stochastic drift.
     */
    bool isDivergenceFree = false;
    /** Whether particles resist strain by stresslets of their own. */
    bool hasStresslets = false;

    // ---- What costs less
    /** Whether MobilityAt::multiply() needs no matrix, so that Krylov methods make sense. */
    bool hasProducts = true;
    /**
     * Whether these products are iterations themselves (MobilityAt::parts()). They serve where
     * bodies are spheres about their centres and nothing is fixed.
     */
    bool productsIterate = false;
    /**
     * Whether noise and differences of such a mobility are slips of its parts (NearAndFar), so that
     * one solve makes velocities of all of them. All particles are spheres then, and the far part
     * has rows of stresslets: five more for each, after all others.
     */
    bool slipsOfParts = false;
    /**
     * Whether products in single precision take less time than exact ones
     * (Accuracy::allowsSinglePrecision()), so that iterations should use them where their error is
     * small enough.
     */
    bool hasSinglePrecision = false;
    /**
     * Whether they take so much less time that a single product should be one of them where its
     * error may be so large: a device makes them.
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
