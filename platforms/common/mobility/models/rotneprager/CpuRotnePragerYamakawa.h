#ifndef RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_H_
#define RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_H_

#include <functional>
#include <map>
#include <optional>

#include "mobility/fastsum/FastSum.h"
#include "mobility/models/rotneprager/PairSums.h"
#include "mobility/models/rotneprager/PairTournament.h"
#include "mobility/models/wall/NoSlipPlane.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility in unbounded fluid or above a no-slip wall, with SIMD and threads.
 * Formulas, references and limits are in mobility/models/rotneprager/RotnePragerYamakawa-inl.h and
 * mobility/models/wall/RotnePragerYamakawaWall-inl.h; mobility/models/wall/NoSlipPlane.h treats
 * particles at the wall.
 *
 * Products visit each pair once for both directions (PairSums.h), by chunks of 128 particles.
 * Chunks meet in rounds, each chunk in one pair a round (PairTournament.h), so the contributions of
 * pairs to a particle are always added in the same order. Results therefore do not depend on the
 * number of threads. Where the machine can multiply and add in one rounding (from AVX2 on), they do
 * not depend on the width of packs either. They agree with RotnePragerYamakawa and
 * RotnePragerYamakawaWall to rounding.
 *
 * Cost: n^2/2 pairs with one square root and one division each (two above a wall), shared by two
 * columns at a time. Pairs near contact take a second, slower pass. benchmarks/README.md compares
 * times with a plain loop over pairs. Nothing is allocated after the first call of each method of a
 * MobilityAt if the number of columns stays the same, unless threads are used.
 */
class CpuRotnePragerYamakawa : public MobilityModel {
public:
    /** Calls task(first, end) for ranges that cover 0 ... count - 1, on several threads. */
    using ForRanges = std::function<void(int count, const std::function<void(int, int)>& task)>;

    /**
     * @param forRanges  called only for work that is worth waking threads for; it must accept any
     *     count. Empty: no threads.
     * @param wall  the wall; empty without one
     * @param fastSums  whether FastSum makes products that need not be exact where it takes less
     *     time
     * @param fastSinglePrecision  MobilityTraits::hasFastSinglePrecision
     */
    CpuRotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity,
                           ForRanges forRanges = {}, const std::optional<NoSlipPlane>& wall = {},
                           bool fastSums = true, bool fastSinglePrecision = false);
    bool acceptsNearby(const Placement& placement) const override {
        return !wall || wall->acceptsNearby(particles, placement.positions);
    }
    std::string objection(const Placement& placement) const override {
        return wall ? wall->objection(particles, placement.positions) : std::string();
    }
    OpenMM::Vec3 placeInFormulas(int i, const OpenMM::Vec3& position) const override {
        return wall ? wall->placeInFormulas(position, particles.radii[i]) : position;
    }
    void ownMobility(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                     Eigen::MatrixXd& mobility) const override;

    std::unique_ptr<MobilityModel> forCollectiveModes(
        const HydrodynamicParticles& spheres) const override;
    bool hasFastProducts(double error) const override;
    std::string describeFastProducts(double error) const override;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    /** The multipole parameters for products with this error; null if no multipoles are used. */
    const FastSum::Accuracy* fastAccuracy(double error) const;
    friend class CpuRotnePragerYamakawaAt;

    const ForRanges forRanges;
    const std::optional<NoSlipPlane> wall;
    // Particles with torque come first, so that blocks of targets and ranges of sources are of one
    // kind. Padding fills the slots of targets up to whole blocks for each kind; sources have no
    // padding. Sums over pairs go by chunks of slots of one kind. The number of chunks depends on
    // the particles alone.
    static constexpr int chunkSize = 128;
    int numSpheres, numSphereBlocks, numBlocks;
    std::vector<SlotRange> chunks;
    static int numSlots(const SlotRange& range) {  // with padding
        return (range.end - range.first + PairSumArrays::alignment - 1) / PairSumArrays::alignment *
               PairSumArrays::alignment;
    }
    std::vector<int> particleOfSource, slotOfSource;
    std::vector<int> rowOfSource, rowOfSlot;  // -1: padding
    std::vector<double> radius;               // of slots
    const bool fastSums;
};

/** A CpuRotnePragerYamakawa at a placement. */
class CpuRotnePragerYamakawaAt : public MobilityAt {
public:
    explicit CpuRotnePragerYamakawaAt(const CpuRotnePragerYamakawa& model);
    /**
     * Sums over all pairs, or, if the allowed error is large enough:
     *
     *  - A FastSum, where so many particles make it faster (FastSum::choose()). For differences the
     *    FastSum is in double precision and has the cubes of the accepted placement.
     *  - Single precision, in about half the time. Differences of positions, overlapping pairs, and
     *    sums over more than 64 particles are in double precision. Everything is in double
     *    precision if radii are not between 1e-4 and 1e4 nm. Results do not depend on the number of
     *    threads, but they depend on the width of packs.
     */
    void multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                  const Accuracy& accuracy) override;
    void dense(Eigen::MatrixXd& mobility) override { denseColumns(0, mobility); }
    void denseColumns(int firstParticle, Eigen::MatrixXd& mobility) override;
    void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                   double factor, Velocities& velocities) override;

protected:
    void moveTo(const Placement& placement, bool nearby) override;
    bool placesAreFinite() const;
    bool preparePlacesInSingle();  // whether floats can hold the positions
    /** Positions and weights of particles, in the order of particles. */
    void placesInFormulas(std::vector<OpenMM::Vec3>& positions, std::vector<double>& weights) const;

private:
    static constexpr int maxColumns = 2;  // at once
    /** Sums over all pairs. */
    void multiplyPairs(const Eigen::MatrixXd& forces, bool inSingle, Eigen::MatrixXd& velocities);
    template <class Number>
    void multiplyPairs(const Eigen::MatrixXd& forces, std::vector<Number>& buffer,
                       Eigen::MatrixXd& velocities);
    FastSum& sumHere(const FastSum::Accuracy& accuracy);
    FastSum& sumNearby(const FastSum::Accuracy& accuracy);
    void sumPairs(const PairSumArrays& arrays);
    template <class Task>
    void split(int count, double pairs, const Task& task) const;
    struct RotnePragerYamakawaArrays arrays(double* result) const;

    const CpuRotnePragerYamakawa& model;
    std::vector<double> x, y, z;  // of slots
    std::vector<double> weight;   // of slots: factors that multiply velocities and forces, 1
                                  // without a wall
    std::vector<double> sources;  // x, y, z, radius of each
    // Of slots, in the layout of PairSumArrays.
    std::vector<double> loads, sums;
    std::vector<float> singleLoads, singlePlaces;
    bool placesFitSingle;
    PairTournament tournament;
    struct Fast {
        std::unique_ptr<FastSum> sum;
        bool isHere = false;    // whether the sum is at this placement
        bool hasCubes = false;  // whether the sum has the cubes of the anchor
    };
    std::map<int, Fast> fast, smooth;  // by order, made on first use; smooth: for differences
    std::vector<OpenMM::Vec3> anchor;  // the last accepted placement, z from the wall
};

}  // namespace RigidHIPlugin

#endif
