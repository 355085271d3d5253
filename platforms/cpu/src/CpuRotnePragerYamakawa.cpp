// Sums over pairs for the Rotne-Prager-Yamakawa mobility, compiled once for each instruction set.

#include "SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "CpuRotnePragerYamakawa.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "CpuRotnePragerYamakawa.h"
#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "rigidbody/BodySet.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

#ifndef RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_ARRAYS_
#define RIGIDHI_CPU_ROTNE_PRAGER_YAMAKAWA_ARRAYS_
namespace RigidHIPlugin {

/** What the loops see of a CpuRotnePragerYamakawa. */
struct RotnePragerYamakawaArrays {
    static const int blockSize = BodySet::blockSize;
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
    const double* loads;  // of each sphere force and torque for each column, of each blob forces
    int columns;          // 1 or 2
};

}  // namespace RigidHIPlugin
#endif

HWY_BEFORE_NAMESPACE();
#include "SimdReal-inl.h"
#include "mobility/RotnePragerYamakawaWall-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

typedef RotnePragerYamakawaArrays Arrays;

/** Out of line: rare, and it would take the registers of the loop. */
HWY_NOINLINE PairMobility<Pack> mixedPairMobility(Pack distance2, Pack a_i, Pack a_j) {
    return pairMobility(distance2, a_i, a_j);
}

/** A pack of targets i with everything about them. */
struct Targets {
    Vector3<Pack> r;  // z from the wall, if there is one
    Pack radius, square;
    Targets(const Arrays& arrays, int slot) {
        load(arrays.x + slot, r.x);
        load(arrays.y + slot, r.y);
        load(arrays.z + slot, r.z);
        load(arrays.radius + slot, radius);
        square = radius * radius;
    }
};

/** Pairs of a pack of targets with source j in unbounded fluid; r = r_i - r_j. */
struct FreePairs {
    Vector3<Pack> r;
    PairMobility<Pack> m;
    HWY_INLINE FreePairs(const Targets& targets, const double* source)
        : r(targets.r - Vector3<Pack>{Pack(source[0]), Pack(source[1]), Pack(source[2])}) {
        const Pack a(source[3]), sum = targets.radius + a, contact2 = sum * sum;
        const Pack distance2 = addedDot(r, r);
        if (HWY_UNLIKELY(!allGreater(distance2, contact2)))
            m = mixedPairMobility(distance2, targets.radius, a);
        else
            m = farPairMobility(distance2, targets.square + a * a);  // rounded as in pairMobility()
    }
    template <int columns, bool targetTorque, bool sourceTorque>
    HWY_INLINE void addVelocities(const Vector3<Pack>* force, const Vector3<Pack>* torque, Vector3<Pack>* velocity,
                                  Vector3<Pack>* omega) const {
        addPairVelocities<columns, targetTorque, sourceTorque>(m, r, force, torque, velocity, omega);
    }
    template <bool targetTorque, bool sourceTorque>
    HWY_INLINE void fillBlocks(const Pack& scale, PairBlocks<Pack>& blocks) const {
        fillPairBlocks<targetTorque, sourceTorque>(m, r, scale, blocks);
    }
};

/** The same above a wall. */
struct WallPairs {
    FreePairs free;
    WallMobility<Pack> wall;
    HWY_INLINE WallPairs(const Targets& targets, const double* source)
        : free(targets, source),
          wall(wallMobility(free.r, targets.r.z, Pack(source[2]), targets.radius, Pack(source[3]))) {}
    template <int columns, bool targetTorque, bool sourceTorque>
    HWY_INLINE void addVelocities(const Vector3<Pack>* force, const Vector3<Pack>* torque, Vector3<Pack>* velocity,
                                  Vector3<Pack>* omega) const {
        free.addVelocities<columns, targetTorque, sourceTorque>(force, torque, velocity, omega);
        addWallVelocities<columns, targetTorque, sourceTorque>(wall, force, torque, velocity, omega);
    }
    template <bool targetTorque, bool sourceTorque>
    HWY_INLINE void fillBlocks(const Pack& scale, PairBlocks<Pack>& blocks) const {
        free.fillBlocks<targetTorque, sourceTorque>(scale, blocks);
        addWallBlocks<targetTorque, sourceTorque>(wall, scale, blocks);
    }
};

template <class Pairs, int columns, bool targetTorque, bool sourceTorque>
HWY_INLINE void sumOverSources(const Arrays& arrays, const Targets& targets, int first, int end, const double* loads,
                               Vector3<Pack>* velocity, Vector3<Pack>* omega) {
    const int stride = sourceTorque ? 6 : 3;
    for (int j = first; j < end; j++, loads += columns * stride) {
        Vector3<Pack> force[columns], torque[columns];
        const Pairs pairs(targets, arrays.sources + 4 * j);
        for (int c = 0; c < columns; c++) {
            const double* from = loads + c * stride;
            force[c] = {Pack(from[0]), Pack(from[1]), Pack(from[2])};
            if (sourceTorque) torque[c] = {Pack(from[3]), Pack(from[4]), Pack(from[5])};
        }
        pairs.template addVelocities<columns, targetTorque, sourceTorque>(force, torque, velocity, omega);
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
    const Targets targets(arrays, slot);
    Vector3<Pack> velocity[columns], omega[columns];
    for (int c = 0; c < columns; c++) velocity[c] = omega[c] = {Pack(0.0), Pack(0.0), Pack(0.0)};
    sumOverSources<Pairs, columns, targetTorque, true>(arrays, targets, 0, arrays.numSpheres, arrays.loads, velocity,
                                                       omega);
    sumOverSources<Pairs, columns, targetTorque, false>(
        arrays, targets, arrays.numSpheres, arrays.numSources,
        arrays.loads + static_cast<size_t>(6 * columns) * arrays.numSpheres, velocity, omega);
    for (int c = 0; c < columns; c++) {
        storeRows(arrays, slot, 0, c, velocity[c]);
        if (targetTorque) storeRows(arrays, slot, 3, c, omega[c]);
    }
}

template <class Pairs, int columns>
void multiply(const Arrays& arrays, int firstBlock, int endBlock) {
    for (int block = firstBlock; block < endBlock; block++)
        for (int lane = 0; lane < Arrays::blockSize; lane += lanes(Pack(0.0))) {
            const int slot = block * Arrays::blockSize + lane;
            if (arrays.rowOfSlot[slot] < 0) continue;  // padding only: it comes last
            if (block < arrays.numSphereBlocks)
                multiplyPack<Pairs, columns, true>(arrays, slot);
            else
                multiplyPack<Pairs, columns, false>(arrays, slot);
        }
}

/** Velocities of the targets in some blocks. */
void multiplyBlocks(const Arrays& arrays, int firstBlock, int endBlock) {
    if (arrays.columns == 1)
        arrays.hasWall ? multiply<WallPairs, 1>(arrays, firstBlock, endBlock)
                       : multiply<FreePairs, 1>(arrays, firstBlock, endBlock);
    else
        arrays.hasWall ? multiply<WallPairs, 2>(arrays, firstBlock, endBlock)
                       : multiply<FreePairs, 2>(arrays, firstBlock, endBlock);
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
    for (int slot = 0; slot < spheres; slot += width) fillPack<Pairs, true, sourceTorque>(arrays, slot, j);
    for (int slot = spheres; slot < end; slot += width) fillPack<Pairs, false, sourceTorque>(arrays, slot, j);
}

/** Columns of the matrix that belong to some sources. */
void fillMatrix(const Arrays& arrays, int firstSource, int endSource) {
    const bool wall = arrays.hasWall;
    for (int j = firstSource; j < endSource; j++) {
        const bool torque = j < arrays.numSpheres;
        (wall     ? torque ? fillColumns<WallPairs, true> : fillColumns<WallPairs, false>
             : torque ? fillColumns<FreePairs, true>
                  : fillColumns<FreePairs, false>)(arrays, j);
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
                                               ForRanges forRanges, const std::optional<NoSlipPlane>& wall)
    : MobilityOperator(particles, viscosity), forRanges(forRanges), wall(wall) {
    const int blockSize = BodySet::blockSize;
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
    // Padding is far from everything, so that it never takes the way of overlaps, and no power of it is infinite.
    const double farAway = 1e30;
    for (auto* v : {&x, &y, &z}) v->assign(rowOfSlot.size(), farAway);
    radius.assign(rowOfSlot.size(), 1.0);
    weight.assign(rowOfSlot.size(), 1.0);
    sources.resize(4 * particles.size());
    for (int j = 0; j < particles.size(); j++)
        radius[slotOfSource[j]] = sources[4 * j + 3] = particles.radii[particleOfSource[j]];
}

std::string CpuRotnePragerYamakawa::objection(const std::vector<OpenMM::Vec3>& positions) const {
    return wall ? wall->objection(particles, positions) : std::string();
}

void CpuRotnePragerYamakawa::setPositions(const std::vector<OpenMM::Vec3>& positions) {
    if (wall) wall->check(particles, positions);
    place(positions, false);
}

void CpuRotnePragerYamakawa::setPositionsNearby(const std::vector<OpenMM::Vec3>& positions) {
    if (wall && wall->reachesBeyond())
        place(positions, true);
    else
        setPositions(positions);
}

void CpuRotnePragerYamakawa::place(const std::vector<OpenMM::Vec3>& positions, bool nearby) {
    for (int j = 0; j < particles.size(); j++) {
        OpenMM::Vec3 r = positions[particleOfSource[j]];
        if (wall) {
            const double radius = sources[4 * j + 3];
            weight[slotOfSource[j]] = nearby ? 1 : wall->weight(r[2], radius);
            r[2] = nearby ? r[2] - wall->getHeight() : wall->heightOver(r[2], radius);
        }
        for (int k = 0; k < 3; k++) sources[4 * j + k] = r[k];
        x[slotOfSource[j]] = r[0];
        y[slotOfSource[j]] = r[1];
        z[slotOfSource[j]] = r[2];
    }
}

RotnePragerYamakawaArrays CpuRotnePragerYamakawa::arrays(double* result) const {
    RotnePragerYamakawaArrays a = {};
    a.x = x.data();
    a.y = y.data();
    a.z = z.data();
    a.radius = radius.data();
    a.weight = weight.data();
    a.rowOfSlot = rowOfSlot.data();
    a.numSphereBlocks = numSphereBlocks;
    a.numBlocks = numBlocks;
    a.sources = sources.data();
    a.rowOfSource = rowOfSource.data();
    a.slotOfSource = slotOfSource.data();
    a.numSpheres = numSpheres;
    a.numSources = particles.size();
    a.hasWall = wall.has_value();
    a.scale = 1 / (8 * M_PI * viscosity);
    a.result = result;
    a.numRows = particles.numRows;
    return a;
}

template <class Task>
void CpuRotnePragerYamakawa::split(int count, double pairs, const Task& task) const {
    // Waking a thread takes 10 to 90 microseconds (benchmarks/README.md), a pair one or two nanoseconds.
    const double pairsThatPay = 1e5;
    if (forRanges && pairs >= pairsThatPay)
        forRanges(count, task);
    else
        task(0, count);
}

void CpuRotnePragerYamakawa::apply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) const {
    velocities.resize(particles.numRows, forces.cols());
    loads.resize(2 * particles.numRows);
    RotnePragerYamakawaArrays arrays = this->arrays(nullptr);
    arrays.loads = loads.data();
    for (int column = 0; column < forces.cols(); column += arrays.columns) {
        arrays.columns = std::min<int>(2, forces.cols() - column);
        arrays.result = velocities.data() + static_cast<size_t>(particles.numRows) * column;
        double* to = loads.data();
        for (int j = 0; j < particles.size(); j++)
            for (int c = column; c < column + arrays.columns; c++)
                for (int k = 0; k < (j < numSpheres ? 6 : 3); k++)
                    *to++ = weight[slotOfSource[j]] * forces(rowOfSource[j] + k, c);
        split(numBlocks, static_cast<double>(particles.size()) * particles.size() * arrays.columns,
              [&arrays](int first, int end) {
                  HWY_DYNAMIC_DISPATCH(multiplyBlocks)
                  (arrays, first, end);
              });
    }
}

void CpuRotnePragerYamakawa::dense(Eigen::MatrixXd& mobility) const {
    mobility.resize(particles.numRows, particles.numRows);
    const RotnePragerYamakawaArrays arrays = this->arrays(mobility.data());
    split(particles.size(), static_cast<double>(particles.size()) * particles.size(), [&arrays](int first, int end) {
        HWY_DYNAMIC_DISPATCH(fillMatrix)(arrays, first, end);
    });
}

}  // namespace RigidHIPlugin

#endif
