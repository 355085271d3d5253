#ifndef RIGIDHI_NEAR_FIELD_H_
#define RIGIDHI_NEAR_FIELD_H_

#include <functional>
#include <vector>

#include "mobility/models/ewald/EwaldSplitting.h"
#include "mobility/models/ewald/NearPair.h"

namespace RigidHIPlugin {

/** Calls task(first, end) for ranges that cover 0 ... count - 1, perhaps on several threads. */
typedef std::function<void(int count, const std::function<void(int, int)>& task)> Ranges;

/**
 * The functions of NearPair for all pairs of kinds: by polynomials in the distance, to 1e-10 of own
 * mobilities, where spheres do not overlap; else themselves, with the part with H by polynomials.
 */
class NearTables {
public:
    /**
     * @param numbers  how many functions: 2 without torques, 6 with them
     * @param margin   beyond the reach, nm, where functions are asked for too
     */
    NearTables(const std::vector<EwaldKind>& kinds, int numbers, double xi, double gap,
               double margin);
    /** How near centres of two kinds must be to be a pair, nm. */
    double reach(int kind_i, int kind_j) const { return pairs[kind_i * numKinds + kind_j].reach; }
    double largestReach() const { return largest; }
    /**
     * In units of 1/(8 pi eta): ttI, ttR of PairFunctions, with torques also tr, rt, rrI, rrR; as
     * many as there are.
     *
     * @param distance  nm, up to the reach and the margin
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
        /** Of each interval polynomials in -1 ... 1, from the highest power on, of each power all
         * functions one after the other. */
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
 * The part of the mobility that is summed over pairs: a sparse matrix of pairs within reach, images
 * and own images included, in boxes of any size with edges along the axes.
 *
 * Pairs belong to accepted positions of particles and stay while a finite difference moves these a
 * little; what pairs do to each other is that of their places. Particles are sorted into cells,
 * with copies of those beyond the faces, so that no pair has to look for its image. Results do not
 * depend on the number of threads.
 *
 * Cost: about 20 ns a pair to be made, 3 ns for each product with one column; 20 bytes a pair, 52
 * with torques.
 */
class NearField {
public:
    explicit NearField(const HydrodynamicParticles& particles);
    /** From now on in this box and with these tables, which must outlive it. */
    void setTables(const NearTables& tables, const std::vector<int>& kindOfParticle,
                   const GridShape& box);
    /** @param keepAnchors  as GridStencils::moveTo(), with a tenth of `spacing` */
    void moveTo(const std::vector<OpenMM::Vec3>& positions, bool keepAnchors, double spacing,
                const Ranges& ranges);
    /** velocities = M forces, in units of 1/(8 pi eta), of one column. */
    void multiply(const double* forces, double* velocities, const Ranges& ranges);
    /** Pairs there are, each counted from both sides. */
    long long getNumPairs() const;
    /** Bytes of a pair. */
    static double memoryOfPair(bool torques) { return torques ? 52 : 20; }

private:
    /** Particles that are done together, with all that is near them. */
    struct Block {
        std::vector<int> first;      // of each particle the first of its neighbours
        std::vector<int> source;     // of each neighbour its number among sources
        std::vector<double> values;  // two numbers a neighbour, or six
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

    const HydrodynamicParticles& particles;
    bool anyTorques = false;
    const NearTables* tables = nullptr;
    std::vector<int> kind;
    GridShape box;

    std::vector<OpenMM::Vec3> anchors;                 // not wrapped
    std::vector<std::array<double, 3> > anchorsInBox;  // the same, in the box
    std::vector<std::array<double, 3> > offsets;       // of particles from anchors
    std::array<int, 3> cells = {0, 0, 0}, depth = {0, 0, 0}, extended = {0, 0, 0};
    std::vector<int> cellOfParticle;             // x, y and z one after the other
    std::vector<int> targets;                    // particles in the order of cells
    std::vector<int> sourceOfTarget;             // each among sources
    std::vector<int> firstOfCell;                // of extended cells, among sources
    std::vector<Source> sources;                 // at anchors
    std::vector<std::array<double, 3> > places;  // of sources, at present
    std::vector<double> strengths;               // of sources: forces, or forces and torques
    std::vector<Block> blocks;
};

}  // namespace RigidHIPlugin

#endif
