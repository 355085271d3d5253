// The Rotne-Prager-Yamakawa mobility with SIMD and threads. The build compiles the code that fills
// the matrix once for each instruction set.

#include "simd/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/models/rotneprager/CpuRotnePragerYamakawa.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/FreeFlow.h"
#include "mobility/models/rotneprager/PairSums.h"
#include "mobility/models/rotneprager/PairTournament.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "simd/WithFlags.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

#ifndef RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_ARRAYS_
#define RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_ARRAYS_
namespace RigidHIPlugin {

/** The data of a CpuRotnePragerYamakawaAt that the loops use. */
struct RotnePragerYamakawaArrays {
    static const int blockSize = PairSumArrays::alignment;
    const double *x, *y, *z, *radius, *weight;  // of target slots; with a wall, z counts from it
    const int* rowOfSlot;
    int numSphereBlocks, numBlocks;
    const double* sources;  // x, y, z, radius of each; spheres first
    const int *rowOfSource, *slotOfSource;
    int numSpheres, numSources;
    bool hasWall;
    double scale;    // 1/(8 pi eta)
    double* result;  // columns of the matrix
    int numRows;
};

}  // namespace RigidHIPlugin
#endif

HWY_BEFORE_NAMESPACE();
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

using Arrays = RotnePragerYamakawaArrays;

/** A pack of targets i with all their data. */
struct Targets {
    Pack x, y, z, radius, square;  // with a wall, z counts from it
    Targets(const Arrays& arrays, int slot) {
        load(arrays.x + slot, x);
        load(arrays.y + slot, y);
        load(arrays.z + slot, z);
        load(arrays.radius + slot, radius);
        square = radius * radius;
    }
};

/**
 * Pairs of which some overlap. The function is not inlined, because such pairs are rare and would
 * use the registers of the loop.
 */
HWY_NOINLINE PairMobility<Pack> mixedPairMobility(const Targets& targets, const double* source) {
    const Vector3<Pack> r = {targets.x - Pack(source[0]), targets.y - Pack(source[1]),
                             targets.z - Pack(source[2])};
    return pairMobility(addedDot(r, r), targets.radius, Pack(source[3]));
}

/** Pairs of a pack of targets with source j in unbounded fluid; r = r_i - r_j. */
struct FreePairs {
    Vector3<Pack> r;
    PairMobility<Pack> m;
    HWY_INLINE FreePairs(const Targets& targets, const double* source)
        : r{targets.x - Pack(source[0]), targets.y - Pack(source[1]), targets.z - Pack(source[2])} {
        const Pack a(source[3]), sum = targets.radius + a, contact2 = sum * sum;
        const Pack distance2 = addedDot(r, r);
        if (HWY_UNLIKELY(!allGreater(distance2, contact2)))
            m = mixedPairMobility(targets, source);
        else
            m = farPairMobility(distance2, targets.square + a * a);  // rounds as pairMobility()
    }
    template <bool targetTorque, bool sourceTorque>
    HWY_INLINE void fillBlocks(const Pack& scale, PairBlocks<Pack>& blocks) const {
        fillPairBlocks<targetTorque, sourceTorque>(m, r, scale, blocks);
    }
};

/** Pairs of a pack of targets with source j above a wall. */
struct WallPairs {
    FreePairs free;
    WallMobility<Pack> wall;
    HWY_INLINE WallPairs(const Targets& targets, const double* source)
        : free(targets, source),
          wall(wallMobility(free.r, targets.z, Pack(source[2]), targets.radius, Pack(source[3]))) {}
    template <bool targetTorque, bool sourceTorque>
    HWY_INLINE void fillBlocks(const Pack& scale, PairBlocks<Pack>& blocks) const {
        free.template fillBlocks<targetTorque, sourceTorque>(scale, blocks);
        addWallBlocks<targetTorque, sourceTorque>(wall, scale, blocks);
    }
};

/** Store the rows of a pack of targets in one column of the matrix. */
template <int count>
HWY_INLINE void storeColumn(const Arrays& arrays, int slot, int column, const Pack (&rows)[count]) {
    double out[count][Arrays::blockSize];
    for (int k = 0; k < count; k++) store(rows[k], out[k]);
    double* to = arrays.result + static_cast<size_t>(arrays.numRows) * column;
    for (int lane = 0; lane < lanes(rows[0]); lane++) {
        const int first = arrays.rowOfSlot[slot + lane];
        if (first < 0) return;
        for (int k = 0; k < count; k++) to[first + k] = out[k][lane];
    }
}

/**
 * Fill the blocks of a pack of targets and source j, such that the matrix is symmetric to the last
 * bit.
 */
template <class Pairs, bool targetTorque, bool sourceTorque>
HWY_INLINE void fillPack(const Arrays& arrays, int slot, int j) {
    const Targets targets(arrays, slot);
    const Pairs pairs(targets, arrays.sources + 4 * j);
    Pack weight;
    load(arrays.weight + slot, weight);
    PairBlocks<Pack> m;
    pairs.template fillBlocks<targetTorque, sourceTorque>(
        Pack(arrays.scale) * (weight * Pack(arrays.weight[arrays.slotOfSource[j]])), m);
    const int column = arrays.rowOfSource[j];
    for (int b = 0; b < 3; b++) {
        if (targetTorque) {
            storeColumn<6>(
                arrays, slot, column + b,
                {m.tt[0][b], m.tt[1][b], m.tt[2][b], m.rt[0][b], m.rt[1][b], m.rt[2][b]});
            if (sourceTorque)
                storeColumn<6>(
                    arrays, slot, column + 3 + b,
                    {m.tr[0][b], m.tr[1][b], m.tr[2][b], m.rr[0][b], m.rr[1][b], m.rr[2][b]});
        } else {
            storeColumn<3>(arrays, slot, column + b, {m.tt[0][b], m.tt[1][b], m.tt[2][b]});
            if (sourceTorque)
                storeColumn<3>(arrays, slot, column + 3 + b, {m.tr[0][b], m.tr[1][b], m.tr[2][b]});
        }
    }
}

template <class Pairs, bool sourceTorque>
HWY_NOINLINE void fillColumns(const Arrays& arrays, int j) {
    const int width = lanes(Pack(0.0)), spheres = arrays.numSphereBlocks * Arrays::blockSize;
    const int end = arrays.numBlocks * Arrays::blockSize;
    for (int slot = 0; slot < end; slot += width) {
        if (arrays.rowOfSlot[slot] < 0) continue;  // padding only
        if (slot < spheres)
            fillPack<Pairs, true, sourceTorque>(arrays, slot, j);
        else
            fillPack<Pairs, false, sourceTorque>(arrays, slot, j);
    }
}

/** Fill the columns of the matrix that belong to some sources. */
void fillMatrix(const Arrays& arrays, int firstSource, int endSource) {
    for (int j = firstSource; j < endSource; j++)
        withFlags(
            [&](auto wall, auto torque) {
                fillColumns<std::conditional_t<wall, WallPairs, FreePairs>, torque>(arrays, j);
            },
            arrays.hasWall, j < arrays.numSpheres);
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(fillMatrix);

namespace {

/**
 * Whether floats can represent the particles' interactions. A float can hold the fifth power of the
 * inverse distance up to a thousand times these radii.
 */
bool fitSingle(const HydrodynamicParticles& particles) {
    const double smallest = 1e-4, largest = 1e4;
    return std::all_of(particles.radii.begin(), particles.radii.end(),
                       [&](double a) { return a >= smallest && a <= largest; });
}

MobilityTraits traitsOf(const HydrodynamicParticles& particles,
                        const std::optional<NoSlipPlane>& wall, bool fastSums,
                        bool fastSinglePrecision) {
    MobilityTraits traits("RotnePragerYamakawa");
    traits.mayObject = wall.has_value();
    traits.holdsNearby = wall && wall->reachesBeyond();
    traits.isHomogeneous = traits.isIsotropic = traits.isDivergenceFree = !wall;
    traits.hasSinglePrecision = fitSingle(particles);
    traits.hasFastSinglePrecision = fastSinglePrecision && traits.hasSinglePrecision;
    traits.rowsWorthIterations = 425;
    // Products for differences keep the cubes of the previous placement.
    const double coarsest = 1e-2;
    traits.isAnchored =
        fastSums && FastSum::choose(coarsest, particles.size(), wall.has_value()) != nullptr;
    return traits;
}

}  // namespace

CpuRotnePragerYamakawa::CpuRotnePragerYamakawa(const HydrodynamicParticles& particles,
                                               double viscosity, ForRanges forRanges,
                                               const std::optional<NoSlipPlane>& wall,
                                               bool fastSums, bool fastSinglePrecision)
    : MobilityModel(particles, viscosity, traitsOf(particles, wall, fastSums, fastSinglePrecision)),
      forRanges(forRanges), wall(wall), fastSums(fastSums) {
    const int blockSize = RotnePragerYamakawaArrays::blockSize;
    for (bool spheres : {true, false}) {
        for (int i = 0; i < particles.size(); i++) {
            if (bool(particles.hasTorque[i]) != spheres) continue;
            particleOfSource.push_back(i);
            rowOfSource.push_back(particles.firstRow[i]);
            slotOfSource.push_back(rowOfSlot.size());
            rowOfSlot.push_back(particles.firstRow[i]);
        }
        while (rowOfSlot.size() % blockSize != 0) rowOfSlot.push_back(-1);
        numBlocks = rowOfSlot.size() / blockSize;
        if (spheres) {
            numSpheres = particleOfSource.size();
            numSphereBlocks = numBlocks;
        }
    }
    // Chunks are so small that threads have many of them, and so large that summing lanes costs
    // little compared with their pairs.
    for (bool spheres : {true, false}) {
        const int begin = spheres ? 0 : numSphereBlocks * blockSize;
        const int end = begin + (spheres ? numSpheres : particles.size() - numSpheres);
        for (int first = begin; first < end; first += chunkSize)
            chunks.push_back({first, std::min(first + chunkSize, end), spheres});
    }
    radius.assign(rowOfSlot.size(), 1.0);
    for (int j = 0; j < particles.size(); j++)
        radius[slotOfSource[j]] = particles.radii[particleOfSource[j]];
}

void CpuRotnePragerYamakawa::ownMobility(const HydrodynamicParticles& body,
                                         const std::vector<OpenMM::Vec3>& sites,
                                         Eigen::MatrixXd& mobility) const {
    CpuRotnePragerYamakawa(body, viscosity, forRanges).at({sites})->dense(mobility);
}

const FastSum::Accuracy* CpuRotnePragerYamakawa::fastAccuracy(double error) const {
    return fastSums ? FastSum::choose(error, particles.size(), wall.has_value()) : nullptr;
}

std::unique_ptr<MobilityModel> CpuRotnePragerYamakawa::forCollectiveModes(
    const HydrodynamicParticles& spheres) const {
    std::optional<NoSlipPlane> plane;
    if (wall) plane.emplace(wall->getHeight(), true);
    return std::make_unique<CpuRotnePragerYamakawa>(spheres, viscosity, forRanges, plane);
}

bool CpuRotnePragerYamakawa::hasFastProducts(double error) const {
    return fastAccuracy(error) != nullptr;
}

std::string CpuRotnePragerYamakawa::describeFastProducts(double error) const {
    const FastSum::Accuracy* accuracy = fastAccuracy(error);
    return accuracy ? "by multipoles of order " + std::to_string(accuracy->order) : std::string();
}

std::unique_ptr<MobilityAt> CpuRotnePragerYamakawa::makePlace() const {
    return std::make_unique<CpuRotnePragerYamakawaAt>(*this);
}

CpuRotnePragerYamakawaAt::CpuRotnePragerYamakawaAt(const CpuRotnePragerYamakawa& model)
    : MobilityAt(model), model(model), tournament(model.chunks.size()) {
    for (auto* v : {&x, &y, &z}) v->assign(model.rowOfSlot.size(), PairSumArrays::farAway);
    weight.assign(model.rowOfSlot.size(), 1.0);
    sources.resize(4 * particles.size());
    for (int j = 0; j < particles.size(); j++)
        sources[4 * j + 3] = particles.radii[model.particleOfSource[j]];
}

void CpuRotnePragerYamakawaAt::moveTo(const Placement& placement, bool nearby) {
    singlePlaces.clear();
    const auto& wall = model.wall;
    for (int j = 0; j < particles.size(); j++) {
        OpenMM::Vec3 r = placement.positions[model.particleOfSource[j]];
        const int slot = model.slotOfSource[j];
        if (wall) {
            const double radius = sources[4 * j + 3];
            weight[slot] = nearby ? 1 : wall->weight(r[2], radius);
            r[2] = nearby ? r[2] - wall->getHeight() : wall->heightOver(r[2], radius);
        }
        for (int k = 0; k < 3; k++) sources[4 * j + k] = r[k];
        x[slot] = r[0];
        y[slot] = r[1];
        z[slot] = r[2];
    }
    for (auto* sums : {&fast, &smooth})
        for (auto& each : *sums) each.second.isHere = false;
    if (nearby && !anchor.empty()) return;
    for (auto& each : smooth) each.second.hasCubes = false;
    if (!model.getTraits().isAnchored) return;
    // A nearby placement does not lift particles from the wall, so neither does the anchor.
    anchor = placement.positions;
    if (wall)
        for (OpenMM::Vec3& r : anchor) r[2] = std::max(0.0, r[2] - wall->getHeight());
}

RotnePragerYamakawaArrays CpuRotnePragerYamakawaAt::arrays(double* result) const {
    RotnePragerYamakawaArrays a = {};
    a.x = x.data();
    a.y = y.data();
    a.z = z.data();
    a.radius = model.radius.data();
    a.weight = weight.data();
    a.rowOfSlot = model.rowOfSlot.data();
    a.numSphereBlocks = model.numSphereBlocks;
    a.numBlocks = model.numBlocks;
    a.sources = sources.data();
    a.rowOfSource = model.rowOfSource.data();
    a.slotOfSource = model.slotOfSource.data();
    a.numSpheres = model.numSpheres;
    a.numSources = particles.size();
    a.hasWall = model.wall.has_value();
    a.scale = 1 / (8 * M_PI * viscosity);
    a.result = result;
    a.numRows = particles.numRows;
    return a;
}

template <class Task>
void CpuRotnePragerYamakawaAt::split(int count, double pairs, const Task& task) const {
    // Waking a thread takes 10 to 90 microseconds (benchmarks/README.md), a pair one or two
    // nanoseconds.
    const double pairsThatPay = 1e5;
    if (model.forRanges && pairs >= pairsThatPay)
        model.forRanges(count, task);
    else
        task(0, count);
}

void CpuRotnePragerYamakawaAt::addFlowAt(const FlowSources& flowSources,
                                         const std::vector<OpenMM::Vec3>& points, double factor,
                                         Velocities& velocities) {
    std::vector<OpenMM::Vec3> positions(particles.size());
    std::vector<double> weights(particles.size());
    for (int j = 0; j < particles.size(); j++) {
        const int p = model.particleOfSource[j];
        positions[p] = OpenMM::Vec3(sources[4 * j], sources[4 * j + 1], sources[4 * j + 2]);
        weights[p] = weight[model.slotOfSource[j]];
    }
    const double unit = factor / (8 * M_PI * viscosity);
    if (model.wall)
        addWallFlowAt(particles, positions, weights, model.wall->getHeight(), flowSources, points,
                      unit, velocities);
    else
        addFreeFlowAt(particles, positions, flowSources, points, unit, velocities);
}

void CpuRotnePragerYamakawaAt::multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                                        const Accuracy& accuracy) {
    const FastSum::Accuracy* fastAccuracy = model.fastAccuracy(accuracy.error);
    if (!fastAccuracy || !placesAreFinite()) {
        multiplyPairs(forces, accuracy.allowsSinglePrecision(), velocities);
        return;
    }
    FastSum& sum = accuracy.purpose == Accuracy::Difference ? sumNearby(*fastAccuracy)
                                                            : sumHere(*fastAccuracy);
    sum.apply(forces, 1 / (8 * M_PI * viscosity), velocities);
}

void CpuRotnePragerYamakawaAt::multiplyPairs(const Eigen::MatrixXd& forces, bool inSingle,
                                             Eigen::MatrixXd& velocities) {
    if (inSingle && model.getTraits().hasSinglePrecision && preparePlacesInSingle())
        multiplyPairs(forces, singleLoads, velocities);
    else
        multiplyPairs(forces, loads, velocities);
}

bool CpuRotnePragerYamakawaAt::preparePlacesInSingle() {
    const size_t numSlots = x.size();
    if (singlePlaces.empty()) {
        singlePlaces.assign(7 * numSlots, 0.0f);
        placesFitSingle = true;
        for (size_t slot = 0; slot < numSlots; slot++) {
            const double r[] = {x[slot], y[slot], z[slot]}, a = model.radius[slot];
            const bool padding = model.rowOfSlot[slot] < 0;
            for (int k = 0; k < 3; k++) {
                placesFitSingle =
                    placesFitSingle && (padding || std::abs(r[k]) <= PairSumArrays::farthestSingle);
                const float high = padding ? PairSumArrays::farAwaySingle : r[k];
                singlePlaces[k * numSlots + slot] = high;
                singlePlaces[(k + 3) * numSlots + slot] = padding ? 0 : r[k] - high;
            }
            singlePlaces[6 * numSlots + slot] = a * a / 3;
        }
    }
    return placesFitSingle;
}

/** Call task(row) for the rows of a range in all columns. */
template <class Task>
static void forRows(const SlotRange& range, int columns, const Task& task) {
    for (int c = 0; c < columns; c++)
        for (int k = 0; k < (range.hasTorque ? 6 : 3); k++) task(6 * c + k);
}

void CpuRotnePragerYamakawaAt::sumPairs(const PairSumArrays& arrays) {
    const int numRows = 6 * maxColumns, chunkSize = CpuRotnePragerYamakawa::chunkSize;
    std::fill(sums.begin(), sums.end(), 0.0);
    tournament.begin();
    split(tournament.getNumPairs(),
          static_cast<double>(particles.size()) * particles.size() * arrays.columns, [&](int, int) {
              double found[2][numRows * chunkSize];
              tournament.play(
                  [&](int a, int b) {
                      const SlotRange* ranges[] = {&model.chunks[a], &model.chunks[b]};
                      for (int side : {0, 1})
                          forRows(*ranges[side], arrays.columns, [&](int row) {
                              std::fill_n(found[side] + row * chunkSize,
                                          model.numSlots(*ranges[side]), 0.0);
                          });
                      addPairs(arrays, *ranges[0], *ranges[1], found[0], found[a == b ? 0 : 1],
                               chunkSize);
                  },
                  [&](int chunk, bool second) {
                      const SlotRange& range = model.chunks[chunk];
                      forRows(range, arrays.columns, [&](int row) {
                          const double* from = found[second ? 1 : 0] + row * chunkSize;
                          double* to = sums.data() + arrays.stride * row + range.first;
                          for (int k = 0; k < range.end - range.first; k++) to[k] += from[k];
                      });
                  });
          });
}

bool CpuRotnePragerYamakawaAt::placesAreFinite() const {
    return Eigen::Map<const Eigen::VectorXd>(sources.data(), sources.size()).allFinite();
}

void CpuRotnePragerYamakawaAt::placesInFormulas(std::vector<OpenMM::Vec3>& positions,
                                                std::vector<double>& weights) const {
    positions.resize(particles.size());
    weights.resize(particles.size());
    for (int j = 0; j < particles.size(); j++) {
        const int p = model.particleOfSource[j];
        positions[p] = OpenMM::Vec3(sources[4 * j], sources[4 * j + 1], sources[4 * j + 2]);
        weights[p] = weight[model.slotOfSource[j]];
    }
}

/** The multipole sum at this placement. */
FastSum& CpuRotnePragerYamakawaAt::sumHere(const FastSum::Accuracy& accuracy) {
    Fast& own = fast[accuracy.order];
    if (!own.sum)
        own.sum =
            std::make_unique<FastSum>(particles, model.wall.has_value(), accuracy, model.forRanges);
    if (!own.isHere) {
        std::vector<OpenMM::Vec3> positions;
        std::vector<double> weights;
        placesInFormulas(positions, weights);
        own.sum->moveTo(positions, weights);
        own.isHere = true;
    }
    return *own.sum;
}

/** Likewise for differences: in double precision, with the cubes of the accepted placement. */
FastSum& CpuRotnePragerYamakawaAt::sumNearby(const FastSum::Accuracy& accuracy) {
    Fast& own = smooth[accuracy.order];
    if (!own.sum) {
        FastSum::Accuracy inDoubles = accuracy;
        inDoubles.floats = 0;
        own.sum = std::make_unique<FastSum>(particles, model.wall.has_value(), inDoubles,
                                            model.forRanges);
    }
    if (!own.isHere) {
        std::vector<OpenMM::Vec3> positions;
        std::vector<double> weights;
        placesInFormulas(positions, weights);
        if (!own.hasCubes) own.sum->moveTo(anchor, weights);
        own.sum->displaceTo(positions, weights);
        own.hasCubes = own.isHere = true;
    }
    return *own.sum;
}

template <class Number>
void CpuRotnePragerYamakawaAt::multiplyPairs(const Eigen::MatrixXd& forces,
                                             std::vector<Number>& buffer,
                                             Eigen::MatrixXd& velocities) {
    const size_t numSlots = x.size();
    velocities.resize(particles.numRows, forces.cols());
    buffer.resize(6 * maxColumns * numSlots);  // starts at zero; padding stays zero
    sums.resize(6 * maxColumns * numSlots);
    PairSumArrays arrays = {};
    arrays.x = x.data();
    arrays.y = y.data();
    arrays.z = z.data();
    arrays.radius = model.radius.data();
    arrays.hasWall = model.wall.has_value();
    arrays.stride = numSlots;
    if constexpr (std::is_same_v<Number, float>) {
        arrays.singleLoads = buffer.data();
        arrays.singlePlaces = singlePlaces.data();
    } else {
        arrays.loads = buffer.data();
    }
    // Floats hold numbers from 1e-38 to 1e38.
    const double largest = std::is_same_v<Number, float> ? forces.cwiseAbs().maxCoeff() : 1;
    const double unit = largest > 0 && std::isfinite(largest) ? largest : 1,
                 scale = unit / (8 * M_PI * viscosity);
    for (int column = 0; column < forces.cols(); column += arrays.columns) {
        arrays.columns = std::min<int>(maxColumns, forces.cols() - column);
        const auto forNumbers = [&](const auto& task) {
            for (int c = 0; c < arrays.columns; c++)
                for (int j = 0; j < particles.size(); j++)
                    for (int k = 0; k < (j < model.numSpheres ? 6 : 3); k++)
                        task(weight[model.slotOfSource[j]], model.rowOfSource[j] + k, column + c,
                             (6 * c + k) * numSlots + model.slotOfSource[j]);
        };
        forNumbers(
            [&](double w, int row, int c, size_t to) { buffer[to] = w * (forces(row, c) / unit); });
        sumPairs(arrays);
        forNumbers([&](double w, int row, int c, size_t from) {
            velocities(row, c) = scale * w * sums[from];
        });
    }
}

void CpuRotnePragerYamakawaAt::denseColumns(int firstParticle, Eigen::MatrixXd& mobility) {
    mobility.resize(particles.numRows, particles.numRows);
    const RotnePragerYamakawaArrays arrays = this->arrays(mobility.data());
    // Sources are spheres first, then blobs, both in the order of the particles.
    const int numSources = particles.size(), numSpheres = model.numSpheres;
    const auto firstOf = [&](int source, int end) {
        while (source < end && firstParticle > 0 &&
               model.rowOfSource[source] <= particles.firstRow[firstParticle - 1])
            source++;
        return source;
    };
    const int firstSphere = firstOf(0, numSpheres), firstBlob = firstOf(numSpheres, numSources),
              spheres = numSpheres - firstSphere, count = spheres + numSources - firstBlob;
    split(count, static_cast<double>(count) * numSources, [&](int first, int end) {
        const auto fill = [&](int from, int to) {
            if (from < to) HWY_DYNAMIC_DISPATCH(fillMatrix)(arrays, from, to);
        };
        fill(firstSphere + first, firstSphere + std::min(end, spheres));
        fill(firstBlob + std::max(first - spheres, 0), firstBlob + end - spheres);
    });
}

}  // namespace RigidHIPlugin

#endif
