// Sums over pairs for the Rotne-Prager-Yamakawa mobility, compiled once for each instruction set.

#include "host/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/models/rotneprager/CpuRotnePragerYamakawa.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/FreeFlow.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

#ifndef RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_ARRAYS_
#define RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_ARRAYS_
namespace RigidHIPlugin {

/** What the loops see of a CpuRotnePragerYamakawaAt. */
struct RotnePragerYamakawaArrays {
    static const int blockSize = 16;            // of the widest pack, floats in AVX-512
    const double *x, *y, *z, *radius, *weight;  // of target slots; z from the wall, if there is one
    const int* rowOfSlot;
    int numSphereBlocks, numBlocks;
    const double* sources;  // x, y, z, radius of each; spheres first
    const int *rowOfSource, *slotOfSource;
    int numSpheres, numSources;
    bool hasWall;
    double scale;    // 1/(8 pi eta)
    double* result;  // columns of it
    int numRows;
    const double* loads;       // of each sphere force and torque for each column, of each blob forces
    const float* singleLoads;  // likewise; for sums in single precision, else null
    int columns;               // 1 or 2
};

}  // namespace RigidHIPlugin
#endif

HWY_BEFORE_NAMESPACE();
#include "host/SimdReal-inl.h"
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

typedef RotnePragerYamakawaArrays Arrays;

/** A pack of targets i with everything about them. Differences of positions are taken in double precision, always. */
template <class Real>
struct Targets {
    Pack x[Real::packs], y[Real::packs], exactZ[Real::packs],
        exactRadius[Real::packs];  // z from the wall, if there is one
    Real z, radius, square;
    Targets(const Arrays& arrays, int slot) {
        for (int k = 0; k < Real::packs; k++, slot += lanes(x[0])) {
            load(arrays.x + slot, x[k]);
            load(arrays.y + slot, y[k]);
            load(arrays.z + slot, exactZ[k]);
            load(arrays.radius + slot, exactRadius[k]);
        }
        round(exactZ, z);
        round(exactRadius, radius);
        square = radius * radius;
    }
};

/** Pairs some of which overlap. Out of line: rare, and it would take the registers of the loop. */
template <class Real>
HWY_NOINLINE PairMobility<Real> mixedPairMobility(const Targets<Real>& targets, const double* source) {
    constexpr int packs = Real::packs;
    Pack ttI[packs], ttR[packs], tr[packs], rt[packs], rrI[packs], rrR[packs];
    for (int k = 0; k < packs; k++) {
        const Vector3<Pack> r = {targets.x[k] - Pack(source[0]), targets.y[k] - Pack(source[1]),
                                 targets.exactZ[k] - Pack(source[2])};
        const auto m = pairMobility(addedDot(r, r), targets.exactRadius[k], Pack(source[3]));
        ttI[k] = m.ttI;
        ttR[k] = m.ttR;
        tr[k] = m.tr;
        rt[k] = m.rt;
        rrI[k] = m.rrI;
        rrR[k] = m.rrR;
    }
    PairMobility<Real> m;
    round(ttI, m.ttI);
    round(ttR, m.ttR);
    round(tr, m.tr);
    round(rt, m.rt);
    round(rrI, m.rrI);
    round(rrR, m.rrR);
    return m;
}

/** Pairs of a pack of targets with source j in unbounded fluid; r = r_i - r_j. */
template <class Number>
struct FreePairs {
    typedef Number Real;
    Vector3<Real> r;
    PairMobility<Real> m;
    HWY_INLINE FreePairs(const Targets<Real>& targets, const double* source) {
        Pack x[Real::packs], y[Real::packs], z[Real::packs];
        for (int k = 0; k < Real::packs; k++) {
            x[k] = targets.x[k] - Pack(source[0]);
            y[k] = targets.y[k] - Pack(source[1]);
            z[k] = targets.exactZ[k] - Pack(source[2]);
        }
        round(x, r.x);
        round(y, r.y);
        round(z, r.z);
        const Real a(source[3]), sum = targets.radius + a, contact2 = sum * sum;
        const Real distance2 = addedDot(r, r);
        if (HWY_UNLIKELY(!allGreater(distance2, contact2)))
            m = mixedPairMobility(targets, source);
        else
            m = farPairMobility(distance2, targets.square + a * a);  // rounded as in pairMobility()
    }
    template <int columns, bool targetTorque, bool sourceTorque>
    HWY_INLINE void addVelocities(const Vector3<Real>* force, const Vector3<Real>* torque, Vector3<Real>* velocity,
                                  Vector3<Real>* omega) const {
        addPairVelocities<columns, targetTorque, sourceTorque>(m, r, force, torque, velocity, omega);
    }
    template <bool targetTorque, bool sourceTorque>
    HWY_INLINE void fillBlocks(const Real& scale, PairBlocks<Real>& blocks) const {
        fillPairBlocks<targetTorque, sourceTorque>(m, r, scale, blocks);
    }
};

/** The same above a wall. */
template <class Number>
struct WallPairs {
    typedef Number Real;
    FreePairs<Real> free;
    WallMobility<Real> wall;
    HWY_INLINE WallPairs(const Targets<Real>& targets, const double* source)
        : free(targets, source),
          wall(wallMobility(free.r, targets.z, Real(source[2]), targets.radius, Real(source[3]))) {}
    template <int columns, bool targetTorque, bool sourceTorque>
    HWY_INLINE void addVelocities(const Vector3<Real>* force, const Vector3<Real>* torque, Vector3<Real>* velocity,
                                  Vector3<Real>* omega) const {
        free.template addVelocities<columns, targetTorque, sourceTorque>(force, torque, velocity, omega);
        addWallVelocities<columns, targetTorque, sourceTorque>(wall, force, torque, velocity, omega);
    }
    template <bool targetTorque, bool sourceTorque>
    HWY_INLINE void fillBlocks(const Real& scale, PairBlocks<Real>& blocks) const {
        free.template fillBlocks<targetTorque, sourceTorque>(scale, blocks);
        addWallBlocks<targetTorque, sourceTorque>(wall, scale, blocks);
    }
};

/** Velocities of a pack of targets, columns of them. */
template <class Real, int columns>
struct Sums {
    Vector3<Real> velocity[columns], omega[columns];
    HWY_INLINE void clear() {
        for (int c = 0; c < columns; c++) velocity[c] = omega[c] = {Real(0.0), Real(0.0), Real(0.0)};
    }
};
template <int columns>
HWY_INLINE void handOver(Vector3<SinglePack> (&from)[columns], Sums<Pack, columns>* to,
                         Vector3<Pack> (Sums<Pack, columns>::*which)[columns]) {
    for (int c = 0; c < columns; c++) {
        Pack x[SinglePack::packs], y[SinglePack::packs], z[SinglePack::packs];
        for (int k = 0; k < SinglePack::packs; k++) {
            x[k] = (to[k].*which)[c].x;
            y[k] = (to[k].*which)[c].y;
            z[k] = (to[k].*which)[c].z;
        }
        addTo(from[c].x, x);
        addTo(from[c].y, y);
        addTo(from[c].z, z);
        for (int k = 0; k < SinglePack::packs; k++) (to[k].*which)[c] = {x[k], y[k], z[k]};
    }
}

template <class Pairs, int columns, bool targetTorque, bool sourceTorque>
HWY_INLINE void sumOverSources(const Arrays& arrays, const Targets<typename Pairs::Real>& targets, int first, int end,
                               const typename Pairs::Real::Scalar* loads, Sums<typename Pairs::Real, columns>& sums) {
    typedef typename Pairs::Real Real;
    const int stride = sourceTorque ? 6 : 3;
    for (int j = first; j < end; j++, loads += columns * stride) {
        Vector3<Real> force[columns], torque[columns];
        const Pairs pairs(targets, arrays.sources + 4 * j);
        for (int c = 0; c < columns; c++) {
            const auto* from = loads + c * stride;
            force[c] = {Real(from[0]), Real(from[1]), Real(from[2])};
            if (sourceTorque) torque[c] = {Real(from[3]), Real(from[4]), Real(from[5])};
        }
        pairs.template addVelocities<columns, targetTorque, sourceTorque>(force, torque, sums.velocity, sums.omega);
    }
}

/** All sources, spheres first. */
template <class Pairs, int columns, bool targetTorque>
HWY_INLINE void sumOverAll(const Arrays& arrays, const Targets<Pack>& targets, Sums<Pack, columns>* sums) {
    sumOverSources<Pairs, columns, targetTorque, true>(arrays, targets, 0, arrays.numSpheres, arrays.loads, *sums);
    sumOverSources<Pairs, columns, targetTorque, false>(
        arrays, targets, arrays.numSpheres, arrays.numSources,
        arrays.loads + static_cast<size_t>(6 * columns) * arrays.numSpheres, *sums);
}
/** Likewise in single precision; sums over so many sources are handed over to doubles, or rounding would grow. */
template <class Pairs, int columns, bool targetTorque>
HWY_INLINE void sumOverAll(const Arrays& arrays, const Targets<SinglePack>& targets, Sums<Pack, columns>* sums) {
    const int atATime = 64, spheres = arrays.numSpheres;
    const float* loads = arrays.singleLoads;
    for (int j = 0, end; j < arrays.numSources; j = end) {
        Sums<SinglePack, columns> part;
        part.clear();
        end = HWY_MIN(j + atATime, j < spheres ? spheres : arrays.numSources);
        if (j < spheres)
            sumOverSources<Pairs, columns, targetTorque, true>(arrays, targets, j, end, loads, part);
        else
            sumOverSources<Pairs, columns, targetTorque, false>(arrays, targets, j, end, loads, part);
        loads += static_cast<size_t>(j < spheres ? 6 : 3) * columns * (end - j);
        handOver(part.velocity, sums, &Sums<Pack, columns>::velocity);
        if (targetTorque) handOver(part.omega, sums, &Sums<Pack, columns>::omega);
    }
}

void storeRows(const Arrays& arrays, int slot, int row, int column, const Vector3<Pack>& v) {
    double out[3][Arrays::blockSize];
    store(v.x, out[0]);
    store(v.y, out[1]);
    store(v.z, out[2]);
    double* to = arrays.result + static_cast<size_t>(arrays.numRows) * column;
    for (int lane = 0; lane < lanes(v.x); lane++) {
        const int first = arrays.rowOfSlot[slot + lane];
        if (first < 0) continue;
        const double factor = arrays.scale * arrays.weight[slot + lane];
        for (int k = 0; k < 3; k++) to[first + row + k] = factor * out[k][lane];
    }
}

template <class Pairs, int columns, bool targetTorque>
HWY_NOINLINE void multiplyPack(const Arrays& arrays, int slot) {
    const Targets<typename Pairs::Real> targets(arrays, slot);
    constexpr int packs = Pairs::Real::packs;
    Sums<Pack, columns> sums[packs];
    for (auto& each : sums) each.clear();
    sumOverAll<Pairs, columns, targetTorque>(arrays, targets, sums);
    for (int k = 0; k < packs; k++, slot += lanes(Pack(0.0)))
        for (int c = 0; c < columns; c++) {
            storeRows(arrays, slot, 0, c, sums[k].velocity[c]);
            if (targetTorque) storeRows(arrays, slot, 3, c, sums[k].omega[c]);
        }
}

template <class Pairs, int columns>
void multiply(const Arrays& arrays, int firstBlock, int endBlock) {
    for (int block = firstBlock; block < endBlock; block++)
        for (int lane = 0; lane < Arrays::blockSize; lane += Pairs::Real::packs * lanes(Pack(0.0))) {
            const int slot = block * Arrays::blockSize + lane;
            if (arrays.rowOfSlot[slot] < 0) continue;  // padding only: it comes last
            if (block < arrays.numSphereBlocks)
                multiplyPack<Pairs, columns, true>(arrays, slot);
            else
                multiplyPack<Pairs, columns, false>(arrays, slot);
        }
}

template <class Real, int columns>
void multiplyColumns(const Arrays& arrays, int firstBlock, int endBlock) {
    arrays.hasWall ? multiply<WallPairs<Real>, columns>(arrays, firstBlock, endBlock)
                   : multiply<FreePairs<Real>, columns>(arrays, firstBlock, endBlock);
}

/** Velocities of the targets in some blocks. */
void multiplyBlocks(const Arrays& arrays, int firstBlock, int endBlock) {
    if (arrays.singleLoads)
        (arrays.columns == 1 ? multiplyColumns<SinglePack, 1> : multiplyColumns<SinglePack, 2>)(arrays, firstBlock,
                                                                                                endBlock);
    else
        (arrays.columns == 1 ? multiplyColumns<Pack, 1> : multiplyColumns<Pack, 2>)(arrays, firstBlock, endBlock);
}

/** Rows of a pack of targets in one column of the matrix. */
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

/** Blocks of a pack of targets and source j. They are so formed that the matrix is symmetric to the last bit. */
template <class Pairs, bool targetTorque, bool sourceTorque>
HWY_INLINE void fillPack(const Arrays& arrays, int slot, int j) {
    const Targets<Pack> targets(arrays, slot);
    const Pairs pairs(targets, arrays.sources + 4 * j);
    Pack weight;
    load(arrays.weight + slot, weight);
    PairBlocks<Pack> m;
    pairs.template fillBlocks<targetTorque, sourceTorque>(
        Pack(arrays.scale) * (weight * Pack(arrays.weight[arrays.slotOfSource[j]])), m);
    const int column = arrays.rowOfSource[j];
    for (int b = 0; b < 3; b++) {
        if (targetTorque) {
            storeColumn<6>(arrays, slot, column + b,
                           {m.tt[0][b], m.tt[1][b], m.tt[2][b], m.rt[0][b], m.rt[1][b], m.rt[2][b]});
            if (sourceTorque)
                storeColumn<6>(arrays, slot, column + 3 + b,
                               {m.tr[0][b], m.tr[1][b], m.tr[2][b], m.rr[0][b], m.rr[1][b], m.rr[2][b]});
        } else {
            storeColumn<3>(arrays, slot, column + b, {m.tt[0][b], m.tt[1][b], m.tt[2][b]});
            if (sourceTorque) storeColumn<3>(arrays, slot, column + 3 + b, {m.tr[0][b], m.tr[1][b], m.tr[2][b]});
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

/** Columns of the matrix that belong to some sources. */
void fillMatrix(const Arrays& arrays, int firstSource, int endSource) {
    const bool wall = arrays.hasWall;
    for (int j = firstSource; j < endSource; j++) {
        const bool torque = j < arrays.numSpheres;
        (wall     ? torque ? fillColumns<WallPairs<Pack>, true> : fillColumns<WallPairs<Pack>, false>
             : torque ? fillColumns<FreePairs<Pack>, true>
                  : fillColumns<FreePairs<Pack>, false>)(arrays, j);
    }
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(multiplyBlocks);
HWY_EXPORT(fillMatrix);

CpuRotnePragerYamakawa::CpuRotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity,
                                               ForRanges forRanges, const std::optional<NoSlipPlane>& wall,
                                               bool fastSums)
    : MobilityModel(particles, viscosity), forRanges(forRanges), wall(wall), fastSums(fastSums) {
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
    radius.assign(rowOfSlot.size(), 1.0);
    for (int j = 0; j < particles.size(); j++) radius[slotOfSource[j]] = particles.radii[particleOfSource[j]];
    // The fifth power of an inverse distance, up to a thousand times these, is a float.
    const double smallest = 1e-4, largest = 1e4;
    fitsSingle = true;
    for (double a : particles.radii) fitsSingle = fitsSingle && a >= smallest && a <= largest;
}

void CpuRotnePragerYamakawa::ownMobility(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                                         Eigen::MatrixXd& mobility) const {
    CpuRotnePragerYamakawa(body, viscosity, forRanges).at({sites})->dense(mobility);
}

std::string CpuRotnePragerYamakawa::describeFastProducts(double error) const {
    const FastSum::Accuracy* accuracy = fastSums ? FastSum::choose(error, particles.size(), wall.has_value()) : nullptr;
    return accuracy ? "by multipoles of order " + std::to_string(accuracy->order) : std::string();
}

std::unique_ptr<MobilityAt> CpuRotnePragerYamakawa::makePlace() const {
    return std::unique_ptr<MobilityAt>(new CpuRotnePragerYamakawaAt(*this));
}

CpuRotnePragerYamakawaAt::CpuRotnePragerYamakawaAt(const CpuRotnePragerYamakawa& model)
    : MobilityAt(model), model(model) {
    // Padding is far from everything, so that it never takes the way of overlaps, and no power of it is infinite.
    const double farAway = 1e30;
    for (auto* v : {&x, &y, &z}) v->assign(model.rowOfSlot.size(), farAway);
    weight.assign(model.rowOfSlot.size(), 1.0);
    sources.resize(4 * particles.size());
    for (int j = 0; j < particles.size(); j++) sources[4 * j + 3] = particles.radii[model.particleOfSource[j]];
}

void CpuRotnePragerYamakawaAt::moveTo(const Placement& placement, bool nearby) {
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
    for (auto& each : fast) each.second.isHere = false;
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
    // Waking a thread takes 10 to 90 microseconds (benchmarks/README.md), a pair one or two nanoseconds.
    const double pairsThatPay = 1e5;
    if (model.forRanges && pairs >= pairsThatPay)
        model.forRanges(count, task);
    else
        task(0, count);
}

void CpuRotnePragerYamakawaAt::apply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) {
    multiply(forces, loads, velocities);
}

void CpuRotnePragerYamakawaAt::addFlowAt(const FlowSources& flowSources, const std::vector<OpenMM::Vec3>& points,
                                         double factor, Velocities& velocities) {
    std::vector<OpenMM::Vec3> positions(particles.size());
    std::vector<double> weights(particles.size());
    for (int j = 0; j < particles.size(); j++) {
        const int p = model.particleOfSource[j];
        positions[p] = OpenMM::Vec3(sources[4 * j], sources[4 * j + 1], sources[4 * j + 2]);
        weights[p] = weight[model.slotOfSource[j]];
    }
    const double unit = factor / (8 * M_PI * viscosity);
    if (model.wall)
        addWallFlowAt(particles, positions, weights, model.wall->getHeight(), flowSources, points, unit, velocities);
    else
        addFreeFlowAt(particles, positions, flowSources, points, unit, velocities);
}

void CpuRotnePragerYamakawaAt::applyRoughly(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) {
    if (model.fitsSingle)
        multiply(forces, singleLoads, velocities);
    else
        multiply(forces, loads, velocities);
}

void CpuRotnePragerYamakawaAt::applyWithin(double error, const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) {
    const FastSum::Accuracy* accuracy =
        model.fastSums ? FastSum::choose(error, particles.size(), model.wall.has_value()) : nullptr;
    const auto isFinite = [](const std::vector<double>& v) {
        return Eigen::Map<const Eigen::VectorXd>(v.data(), v.size()).allFinite();
    };
    if (!accuracy || !isFinite(sources)) {
        MobilityAt::applyWithin(error, forces, velocities);
        return;
    }
    Fast& own = fast[accuracy->order];
    if (!own.sum) own.sum.reset(new FastSum(particles, model.wall.has_value(), *accuracy, model.forRanges));
    if (!own.isHere) {
        std::vector<OpenMM::Vec3> positions(particles.size());
        std::vector<double> weights(particles.size());
        for (int j = 0; j < particles.size(); j++) {
            const int p = model.particleOfSource[j];
            positions[p] = OpenMM::Vec3(sources[4 * j], sources[4 * j + 1], sources[4 * j + 2]);
            weights[p] = weight[model.slotOfSource[j]];
        }
        own.sum->moveTo(positions, weights);
        own.isHere = true;
    }
    own.sum->apply(forces, 1 / (8 * M_PI * viscosity), velocities);
}

template <class Number>
void CpuRotnePragerYamakawaAt::multiply(const Eigen::MatrixXd& forces, std::vector<Number>& buffer,
                                        Eigen::MatrixXd& velocities) const {
    velocities.resize(particles.numRows, forces.cols());
    buffer.resize(2 * particles.numRows);
    RotnePragerYamakawaArrays arrays = this->arrays(nullptr);
    if constexpr (std::is_same_v<Number, float>)
        arrays.singleLoads = buffer.data();
    else
        arrays.loads = buffer.data();
    // Floats hold numbers from 1e-38 to 1e38.
    const double largest = std::is_same_v<Number, float> ? forces.cwiseAbs().maxCoeff() : 1;
    const double unit = largest > 0 && std::isfinite(largest) ? largest : 1;
    arrays.scale *= unit;
    for (int column = 0; column < forces.cols(); column += arrays.columns) {
        arrays.columns = std::min<int>(2, forces.cols() - column);
        arrays.result = velocities.data() + static_cast<size_t>(particles.numRows) * column;
        Number* to = buffer.data();
        for (int j = 0; j < particles.size(); j++)
            for (int c = column; c < column + arrays.columns; c++)
                for (int k = 0; k < (j < model.numSpheres ? 6 : 3); k++)
                    *to++ = weight[model.slotOfSource[j]] * (forces(model.rowOfSource[j] + k, c) / unit);
        split(model.numBlocks, static_cast<double>(particles.size()) * particles.size() * arrays.columns,
              [&arrays](int first, int end) {
                  HWY_DYNAMIC_DISPATCH(multiplyBlocks)
                  (arrays, first, end);
              });
    }
}

void CpuRotnePragerYamakawaAt::dense(Eigen::MatrixXd& mobility) {
    mobility.resize(particles.numRows, particles.numRows);
    const RotnePragerYamakawaArrays arrays = this->arrays(mobility.data());
    split(particles.size(), static_cast<double>(particles.size()) * particles.size(), [&arrays](int first, int end) {
        HWY_DYNAMIC_DISPATCH(fillMatrix)(arrays, first, end);
    });
}

}  // namespace RigidHIPlugin

#endif
