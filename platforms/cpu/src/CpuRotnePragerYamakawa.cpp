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
    const double *x, *y, *z, *radius;  // of target slots
    const int* rowOfSlot;
    int numSphereBlocks, numBlocks;
    const double* sources;  // x, y, z, radius of each; spheres first
    const int* rowOfSource;
    int numSpheres, numSources;
    const double* loads;  // of each sphere force and torque for each column, of each blob forces
    int columns;          // 1 or 2
    double scale;         // 1/(8 pi eta)
    double* result;       // columns of it
    int numRows;
};

}  // namespace RigidHIPlugin
#endif

HWY_BEFORE_NAMESPACE();
#include "SimdReal-inl.h"
#include "mobility/RotnePragerYamakawa-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

typedef RotnePragerYamakawaArrays Arrays;

/** Out of line: rare, and it would take the registers of the loop. */
HWY_NOINLINE PairMobility<Pack> mixedPairMobility(Pack distance2, Pack a_i, Pack a_j) {
    return pairMobility(distance2, a_i, a_j);
}

/** A pack of targets i with everything about them. */
struct Targets {
    Vector3<Pack> r;
    Pack radius, square;
    Targets(const Arrays& arrays, int slot) {
        load(arrays.x + slot, r.x);
        load(arrays.y + slot, r.y);
        load(arrays.z + slot, r.z);
        load(arrays.radius + slot, radius);
        square = radius * radius;
    }
    /** Their pairs with source j; r = r_i - r_j. */
    HWY_INLINE PairMobility<Pack> pairs(const Arrays& arrays, int j, Vector3<Pack>& separation) const {
        const double* source = arrays.sources + 4 * j;
        separation = r - Vector3<Pack>{Pack(source[0]), Pack(source[1]), Pack(source[2])};
        const Pack a(source[3]), sum = radius + a, contact2 = sum * sum;
        const Pack distance2 = addedDot(separation, separation);
        if (HWY_UNLIKELY(!allGreater(distance2, contact2))) return mixedPairMobility(distance2, radius, a);
        return farPairMobility(distance2, square + a * a);  // rounded as in pairMobility()
    }
};

template <int columns, bool targetTorque, bool sourceTorque>
HWY_INLINE void sumOverSources(const Arrays& arrays, const Targets& targets, int first, int end, const double* loads,
                               Vector3<Pack>* velocity, Vector3<Pack>* omega) {
    const int stride = sourceTorque ? 6 : 3;
    for (int j = first; j < end; j++, loads += columns * stride) {
        Vector3<Pack> r, force[columns], torque[columns];
        const PairMobility<Pack> m = targets.pairs(arrays, j, r);
        for (int c = 0; c < columns; c++) {
            const double* from = loads + c * stride;
            force[c] = {Pack(from[0]), Pack(from[1]), Pack(from[2])};
            if (sourceTorque) torque[c] = {Pack(from[3]), Pack(from[4]), Pack(from[5])};
        }
        addPairVelocities<columns, targetTorque, sourceTorque>(m, r, force, torque, velocity, omega);
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
        for (int k = 0; k < 3; k++) to[first + row + k] = arrays.scale * out[k][lane];
    }
}

template <int columns, bool targetTorque>
HWY_NOINLINE void multiplyPack(const Arrays& arrays, int slot) {
    const Targets targets(arrays, slot);
    Vector3<Pack> velocity[columns], omega[columns];
    for (int c = 0; c < columns; c++) velocity[c] = omega[c] = {Pack(0.0), Pack(0.0), Pack(0.0)};
    sumOverSources<columns, targetTorque, true>(arrays, targets, 0, arrays.numSpheres, arrays.loads, velocity, omega);
    sumOverSources<columns, targetTorque, false>(arrays, targets, arrays.numSpheres, arrays.numSources,
                                                 arrays.loads + static_cast<size_t>(6 * columns) * arrays.numSpheres,
                                                 velocity, omega);
    for (int c = 0; c < columns; c++) {
        storeRows(arrays, slot, 0, c, velocity[c]);
        if (targetTorque) storeRows(arrays, slot, 3, c, omega[c]);
    }
}

template <int columns>
void multiply(const Arrays& arrays, int firstBlock, int endBlock) {
    for (int block = firstBlock; block < endBlock; block++)
        for (int lane = 0; lane < Arrays::blockSize; lane += lanes(Pack(0.0))) {
            const int slot = block * Arrays::blockSize + lane;
            if (arrays.rowOfSlot[slot] < 0) continue;  // padding only: it comes last
            if (block < arrays.numSphereBlocks)
                multiplyPack<columns, true>(arrays, slot);
            else
                multiplyPack<columns, false>(arrays, slot);
        }
}

/** Velocities of the targets in some blocks. */
void multiplyBlocks(const Arrays& arrays, int firstBlock, int endBlock) {
    if (arrays.columns == 1)
        multiply<1>(arrays, firstBlock, endBlock);
    else
        multiply<2>(arrays, firstBlock, endBlock);
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

template <bool targetTorque, bool sourceTorque>
HWY_INLINE void fillPack(const Arrays& arrays, int slot, int j) {
    const Targets targets(arrays, slot);
    Vector3<Pack> r;
    const PairMobility<Pack> m = targets.pairs(arrays, j, r);
    const Pack scale(arrays.scale), zero(0.0);
    const int column = arrays.rowOfSource[j];
    // Every product is formed in the same way here and in the mirrored place, so the matrix is symmetric to the last bit.
    const auto symmetric = [&](const Pack& identity, const Pack& outer, Pack(&block)[3][3]) {
        const Pack v[3] = {r.x, r.y, r.z};
        for (int a = 0; a < 3; a++) {
            block[a][a] = scale * (identity + outer * (v[a] * v[a]));
            for (int b = 0; b < a; b++) block[a][b] = block[b][a] = scale * (outer * (v[a] * v[b]));
        }
    };
    const auto crossing = [&](const Pack& factor, Pack(&block)[3][3]) {
        const Pack x = scale * (factor * r.x), y = scale * (factor * r.y), z = scale * (factor * r.z);
        const Pack rows[3][3] = {{zero, z, zero - y}, {zero - z, zero, x}, {y, zero - x, zero}};
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) block[a][b] = rows[a][b];
    };
    Pack tt[3][3], rt[3][3], tr[3][3], rr[3][3];
    symmetric(m.ttI, m.ttR, tt);
    if (targetTorque) crossing(m.rt, rt);
    if (sourceTorque) crossing(m.tr, tr);
    if (targetTorque && sourceTorque) symmetric(m.rrI, m.rrR, rr);
    for (int b = 0; b < 3; b++) {
        if (targetTorque) {
            storeColumn<6>(arrays, slot, column + b, {tt[0][b], tt[1][b], tt[2][b], rt[0][b], rt[1][b], rt[2][b]});
            if (sourceTorque)
                storeColumn<6>(arrays, slot, column + 3 + b,
                               {tr[0][b], tr[1][b], tr[2][b], rr[0][b], rr[1][b], rr[2][b]});
        } else {
            storeColumn<3>(arrays, slot, column + b, {tt[0][b], tt[1][b], tt[2][b]});
            if (sourceTorque) storeColumn<3>(arrays, slot, column + 3 + b, {tr[0][b], tr[1][b], tr[2][b]});
        }
    }
}

template <bool sourceTorque>
HWY_NOINLINE void fillColumns(const Arrays& arrays, int j) {
    const int width = lanes(Pack(0.0)), spheres = arrays.numSphereBlocks * Arrays::blockSize;
    const int end = arrays.numBlocks * Arrays::blockSize;
    for (int slot = 0; slot < spheres; slot += width) fillPack<true, sourceTorque>(arrays, slot, j);
    for (int slot = spheres; slot < end; slot += width) fillPack<false, sourceTorque>(arrays, slot, j);
}

/** Columns of the matrix that belong to some sources. */
void fillMatrix(const Arrays& arrays, int firstSource, int endSource) {
    for (int j = firstSource; j < endSource; j++) {
        if (j < arrays.numSpheres)
            fillColumns<true>(arrays, j);
        else
            fillColumns<false>(arrays, j);
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
                                               ForRanges forRanges)
    : MobilityOperator(particles, viscosity), forRanges(forRanges) {
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
    sources.resize(4 * particles.size());
    for (int j = 0; j < particles.size(); j++)
        radius[slotOfSource[j]] = sources[4 * j + 3] = particles.radii[particleOfSource[j]];
}

void CpuRotnePragerYamakawa::setPositions(const std::vector<OpenMM::Vec3>& positions) {
    for (int j = 0; j < particles.size(); j++) {
        const OpenMM::Vec3& r = positions[particleOfSource[j]];
        for (int k = 0; k < 3; k++) sources[4 * j + k] = r[k];
        x[slotOfSource[j]] = r[0];
        y[slotOfSource[j]] = r[1];
        z[slotOfSource[j]] = r[2];
    }
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
    RotnePragerYamakawaArrays arrays = {x.data(),
                                        y.data(),
                                        z.data(),
                                        radius.data(),
                                        rowOfSlot.data(),
                                        numSphereBlocks,
                                        numBlocks,
                                        sources.data(),
                                        rowOfSource.data(),
                                        numSpheres,
                                        particles.size(),
                                        loads.data(),
                                        1,
                                        1 / (8 * M_PI * viscosity),
                                        nullptr,
                                        particles.numRows};
    for (int column = 0; column < forces.cols(); column += arrays.columns) {
        arrays.columns = std::min<int>(2, forces.cols() - column);
        arrays.result = velocities.data() + static_cast<size_t>(particles.numRows) * column;
        double* to = loads.data();
        for (int j = 0; j < particles.size(); j++)
            for (int c = column; c < column + arrays.columns; c++)
                for (int k = 0; k < (j < numSpheres ? 6 : 3); k++) *to++ = forces(rowOfSource[j] + k, c);
        split(numBlocks, static_cast<double>(particles.size()) * particles.size() * arrays.columns,
              [&arrays](int first, int end) {
                  HWY_DYNAMIC_DISPATCH(multiplyBlocks)
                  (arrays, first, end);
              });
    }
}

void CpuRotnePragerYamakawa::dense(Eigen::MatrixXd& mobility) const {
    mobility.resize(particles.numRows, particles.numRows);
    const RotnePragerYamakawaArrays arrays = {x.data(),
                                              y.data(),
                                              z.data(),
                                              radius.data(),
                                              rowOfSlot.data(),
                                              numSphereBlocks,
                                              numBlocks,
                                              sources.data(),
                                              rowOfSource.data(),
                                              numSpheres,
                                              particles.size(),
                                              nullptr,
                                              0,
                                              1 / (8 * M_PI * viscosity),
                                              mobility.data(),
                                              particles.numRows};
    split(particles.size(), static_cast<double>(particles.size()) * particles.size(), [&arrays](int first, int end) {
        HWY_DYNAMIC_DISPATCH(fillMatrix)(arrays, first, end);
    });
}

}  // namespace RigidHIPlugin

#endif
