#ifndef RIGIDHI_NEAR_FIELD_H_
#define RIGIDHI_NEAR_FIELD_H_

#include <functional>
#include <vector>

#include "mobility/models/ewald/EwaldSplitting.h"
#include "mobility/models/ewald/NearPair.h"

namespace RigidHIPlugin {

/** Calls task(first, end) for ranges that cover 0 ... count - 1, perhaps on several threads. */
using Ranges = std::function<void(int count, const std::function<void(int, int)>& task)>;

/**
 * Tables of the functions of NearPair for all pairs of kinds of particles. For spheres that do not
 * overlap, polynomials in the distance give the functions, to 1e-10 of own mobilities. For
 * overlapping spheres, polynomials give only the part with H, and the closed form is computed.
 */
class NearTables {
public:
    static constexpr int withStresslets = 14;
    /**
     * @param kinds    radii may be 0; two points are not a pair
     * @param numbers  number of functions: 2 without torques, 6 with torques, `withStresslets` with
     *     stresslets, too
     * @param margin  distance beyond the reach up to which the tables extend, nm
     */
    NearTables(const std::vector<EwaldKind>& kinds, int numbers, double xi, double gap,
               double margin);
    /** The largest distance of centres at which particles of two kinds are a pair, nm. */
    double reach(int kind_i, int kind_j) const { return pairs[kind_i * numKinds + kind_j].reach; }
    double largestReach() const { return largest; }
    /**
     * The functions in units of 1/(8 pi eta), `numbers` of them: ttI and ttR of PairFunctions; with
     * torques also tr, rt, rrI and rrR; with stresslets also the others in their order.
     *
     * @param distance  nm, up to the reach plus the margin
     */
    template <int numbers>
    void at(int kind_i, int kind_j, double distance, double* f) const {
        const Pair& pair = pairs[kind_i * numKinds + kind_j];
        if (distance < pair.contact)
            overlapping<numbers>(pair, distance, f);
        else
            evaluate<numbers>(pair.apart, (distance - pair.contact) * pair.inverseStep, f);
    }

private:
    static constexpr int degree = 6;
    struct Pair {
        double radius_i, radius_j, contact, reach, inverseStep;
        /**
         * For each interval, polynomials in -1 ... 1, from the highest power down; for each power,
         * the coefficients of all functions one after the other.
         */
        std::vector<double> apart, screened;
    };
    template <int numbers>
    static void evaluate(const std::vector<double>& table, double inSteps, double* f) {
        const int interval = (int)inSteps;
        const double x = 2 * (inSteps - interval) - 1;
        const double* p = &table[(size_t)interval * numbers * (degree + 1)];
        for (int c = 0; c < numbers; c++) f[c] = p[c];
        for (int m = 1; m <= degree; m++)
            for (int c = 0; c < numbers; c++) f[c] = f[c] * x + p[m * numbers + c];
    }
    template <int numbers>
    void overlapping(const Pair& pair, double distance, double* f) const;
    const int numKinds;
    double largest = 0;
    std::vector<Pair> pairs;
};

/**
 * The part of the mobility that is a sum over pairs: a sparse matrix of pairs within reach. Pairs
 * include images, also a particle's own images. Boxes may have any size. Cells are rectangular in
 * the coordinates of GridSkew.
 *
 * The list of pairs belongs to accepted positions of particles and stays the same while a finite
 * difference moves the particles a little. The values of the pairs belong to the present positions.
 * Cells have copies of particles beyond the faces, so no pair has to look for its image. Results do
 * not depend on the number of threads.
 *
 * Cost: about 20 ns to make a pair, and 3 ns for each pair in a product with one column. Memory: 20
 * bytes for each pair, 52 with torques, 116 with stresslets.
 */
class NearField {
public:
    /**
     * @param stresslets  whether each particle has 5 more rows, after all others. All particles
     *     then have torques.
     */
    explicit NearField(const HydrodynamicParticles& particles, bool stresslets = false);
    /** Use this box and these tables from now on. The tables must outlive the NearField. */
    void setTables(const NearTables& tables, const std::vector<int>& kindOfParticle,
                   const GridShape& box);
    /** @param keepAnchors  as GridStencils::moveTo(), with a tenth of `spacing` */
    void moveTo(const std::vector<OpenMM::Vec3>& positions, bool keepAnchors, double spacing,
                const Ranges& ranges);
    /** Compute velocities = M forces, in units of 1/(8 pi eta), for one column. */
    void multiply(const double* forces, double* velocities, const Ranges& ranges);
    /** The number of pairs, each counted from both sides. */
    long long getNumPairs() const;
    /** Bytes of a pair. */
    static double memoryOfPair(bool torques, bool stresslets = false) {
        return stresslets ? 116 : torques ? 52 : 20;
    }

private:
    /** Particles that are treated together, with all their neighbours. */
    struct Block {
        std::vector<int> first;      // for each particle, the first of its neighbours
        std::vector<int> source;     // for each neighbour, its number among sources
        std::vector<double> values;  // 2, 6 or 14 numbers for each neighbour
    };
    static constexpr int particlesOfBlock = 64;
    /** A particle, or its copy in another period. */
    struct Source {
        double x, y, z;
        int particle;
    };
    void findAnchors(const std::vector<OpenMM::Vec3>& positions, bool keep, double spacing);
    void sortIntoCells();
    void findNeighbours(Block& block, int firstTarget, int endTarget) const;
    template <int numbers>
    void findValues(Block& block, int firstTarget, int endTarget) const;
    template <bool torques>
    void multiplyBlock(const Block& block, int firstTarget, const double* forces,
                       double* velocities) const;

    void multiplyBlockWithStresslets(const Block& block, int firstTarget, const double* forces,
                                     double* velocities) const;

    const HydrodynamicParticles& particles;
    const bool stresslets;
    bool anyTorques = false;
    const NearTables* tables = nullptr;
    std::vector<int> kind;
    GridShape box;

    std::vector<OpenMM::Vec3> anchors;                // not wrapped
    std::vector<std::array<double, 3>> anchorsInBox;  // anchors wrapped into the box
    std::vector<std::array<double, 3>> offsets;       // of particles from anchors
    std::array<int, 3> cells = {0, 0, 0}, depth = {0, 0, 0}, extended = {0, 0, 0};
    std::vector<int> cellOfParticle;            // x, y and z one after the other
    std::vector<int> targets;                   // particles in the order of cells
    std::vector<int> sourceOfTarget;            // index among sources
    std::vector<int> firstOfCell;               // index among sources, for extended cells
    std::vector<Source> sources;                // at anchors
    std::vector<std::array<double, 3>> places;  // of sources, at the present positions
    std::vector<double> strengths;              // of sources: forces, or forces and torques
    std::vector<Block> blocks;
};

}  // namespace RigidHIPlugin

#endif
