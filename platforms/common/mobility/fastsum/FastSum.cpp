// Products with the Rotne-Prager-Yamakawa mobility by multipoles. The build compiles the loops once
// for each instruction set.

#include "simd/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/fastsum/FastSum.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/fastsum/FastSum.h"
#include "simd/WithFlags.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

#ifndef RIGIDHI_FAST_SUM_TASKS_
#define RIGIDHI_FAST_SUM_TASKS_
namespace RigidHIPlugin {

/**
 * Slots of the quantities that are multiplied by the basis and summed over the particles of a leaf.
 */
enum FastSumSlot {
    Charge = 0,
    PotentialCharge = 3,
    Torque = 4,
    PotentialDipole = 7,
    WallDipole = 10,
    WallQuadrupole = 13
};
const int numSlots = 16;
/**
 * Slots of the values that a local expansion gives at a particle: f + grad g, grad f, grad div f.
 */
enum FastSumView { Flow = 0, Gradient = 3, GradientOfDivergence = 12 };

/** Far pairs of one class, [first, end), through its matrix. */
template <class Number>
struct FarTask {
    static const int rowsAtOnce = 6;
    int size, columns;     // of the basis; of forces
    const Number* matrix;  // in panels of rows
    const Number* signs;   // of the elements
    double D[3];           // from source to target, in halves of the source's edge
    const ClusterTree::FarPair* pairs;
    int first, end;
    const double* half;     // of the edges of cells, and of their images
    const Number* moments;  // of cells, and of their images
    Number* locals;
    Number *in, *out;  // space for 4 x 16 numbers for each row, a whole number of panels
};

/** Pairs of particles: the targets of one leaf with all particles in cells near it. */
struct NearTask {
    const double *x, *y, *z, *radius;
    int first, endSpheres, end;  // targets
    const int (*sources)[3];     // likewise, of each near cell
    int numSources;
    bool hasWall, single;
    double centre[3];
    int columns;
    const double* loads;  // force and torque for each column
    double* velocities;
    double* space;  // for 18 numbers for each source
    int* index;     // for each source
};

}  // namespace RigidHIPlugin
#endif

HWY_BEFORE_NAMESPACE();
#include "mobility/models/rotneprager/RoundedPairs-inl.h"
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

/** sums[element][slot] += R[element] weights[slot] */
void addToSlots(int size, const double* R, const double* weights, double* sums) {
    const Doubles d;
    const int width = hn::Lanes(d);
    for (int s = 0; s < numSlots; s += width) {
        const auto w = hn::LoadU(d, weights + s);
        for (int a = 0; a < size; a++) {
            double* to = sums + a * numSlots + s;
            hn::StoreU(hn::MulAdd(hn::Set(d, R[a]), w, hn::LoadU(d, to)), d, to);
        }
    }
}

/** views[slot] = sum over elements of R[element] coefficients[element][slot] */
void viewSlots(int size, const double* R, const double* coefficients, double* views) {
    const Doubles d;
    const int width = hn::Lanes(d);
    for (int s = 0; s < numSlots; s += width) {
        auto even = hn::Zero(d), odd = hn::Zero(d);
        int a = 0;
        for (; a + 1 < size; a += 2) {
            even =
                hn::MulAdd(hn::Set(d, R[a]), hn::LoadU(d, coefficients + a * numSlots + s), even);
            odd = hn::MulAdd(hn::Set(d, R[a + 1]),
                             hn::LoadU(d, coefficients + (a + 1) * numSlots + s), odd);
        }
        if (a < size)
            even =
                hn::MulAdd(hn::Set(d, R[a]), hn::LoadU(d, coefficients + a * numSlots + s), even);
        hn::StoreU(hn::Add(even, odd), d, views + s);
    }
}

/** Shift all columns of moments or local expansions: to_a += sum_b matrix_ab from_b, b up to
 * `last`_a. */
void addShifted(int size, const double* matrix, int rowStride, int columnStride, const int* first,
                const int* end, int numbers, const double* from, double* to) {
    for (int a = 0; a < size; a++) {
        double* sums = to + a * numbers;
        for (int b = first[a]; b < end[a]; b++) {
            const double factor = matrix[a * rowStride + b * columnStride];
            const double* in = from + b * numbers;
            for (int k = 0; k < numbers; k++) sums[k] += factor * in[k];
        }
    }
}

/**
 * Each lane is a column of a pair of cells. The four functions of each follow one another in
 * memory.
 */
template <class Number, class D>
HWY_NOINLINE void translateLanes(const FarTask<Number>& task, D d) {
    constexpr int rows = FarTask<Number>::rowsAtOnce;
    // As many rows as registers (32, or 16) can hold sums and terms for.
    constexpr int rowsInRegisters = HWY_TARGET <= HWY_AVX3 ? rows : rows / 2;
    using V = hn::Vec<D>;
    const int width = hn::Lanes(d), columns = task.columns, size = task.size;
    const int stride = 4 * width;
    const size_t ofCell = static_cast<size_t>(4) * columns * size;
    const int lanesOfAll = (task.end - task.first) * columns;
    const hn::CappedTag<Number, 4> four;
    const int quarter = hn::Lanes(four);
    HWY_ALIGN Number quads[4 * 16];
    for (int k = 0; k < 4 * 16; k++) quads[k] = 0;
    for (int lane = 0; lane < lanesOfAll; lane += width) {
        const int count = HWY_MIN(width, lanesOfAll - lane);
        const Number* from[16];
        Number* to[16];
        HWY_ALIGN Number scaleOfFlow[16], scaleOfPotential[16];
        for (int k = 0; k < width; k++) scaleOfFlow[k] = scaleOfPotential[k] = 0;
        for (int k = 0; k < count; k++) {
            const auto& pair = task.pairs[task.first + (lane + k) / columns];
            const int column = (lane + k) % columns;
            from[k] = task.moments + ofCell * pair.source + 4 * column;
            to[k] = task.locals + ofCell * pair.target + 4 * column;
            scaleOfFlow[k] = static_cast<Number>(1 / task.half[pair.source]);
            scaleOfPotential[k] = static_cast<Number>(1 / task.half[pair.target]);
        }
        for (int b = 0; b < size; b++) {
            for (int k = 0; k < count; k++)
                for (int q = 0; q < 4; q += quarter)
                    hn::StoreU(hn::LoadU(four, from[k] + 4 * columns * b + q), four,
                               quads + 4 * k + q);
            V v0, v1, v2, v3;
            hn::LoadInterleaved4(d, quads, v0, v1, v2, v3);
            const V sign = hn::Set(d, task.signs[b]);
            Number* in = task.in + static_cast<size_t>(stride) * b;
            hn::StoreU(hn::Mul(sign, v0), d, in);
            hn::StoreU(hn::Mul(sign, v1), d, in + width);
            hn::StoreU(hn::Mul(sign, v2), d, in + 2 * width);
            hn::StoreU(hn::Mul(sign, v3), d, in + 3 * width);
        }
        const Number* matrix = task.matrix;
        for (int a = 0; a < size; a += rows) {
            for (int part = 0; part < rows; part += rowsInRegisters) {
                V sums[rowsInRegisters][4];
                for (auto& row : sums)
                    for (V& sum : row) sum = hn::Zero(d);
                const Number *in = task.in, *m_b = matrix + part;
                for (int b = 0; b < size; b++, in += stride, m_b += rows) {
                    const V v0 = hn::LoadU(d, in), v1 = hn::LoadU(d, in + width),
                            v2 = hn::LoadU(d, in + 2 * width), v3 = hn::LoadU(d, in + 3 * width);
                    for (int q = 0; q < rowsInRegisters; q++) {
                        const V m = hn::Set(d, m_b[q]);
                        sums[q][0] = hn::MulAdd(m, v0, sums[q][0]);
                        sums[q][1] = hn::MulAdd(m, v1, sums[q][1]);
                        sums[q][2] = hn::MulAdd(m, v2, sums[q][2]);
                        sums[q][3] = hn::MulAdd(m, v3, sums[q][3]);
                    }
                }
                Number* out = task.out + static_cast<size_t>(stride) * (a + part);
                for (int q = 0; q < rowsInRegisters; q++)
                    for (int k = 0; k < 4; k++)
                        hn::StoreU(sums[q][k], d, out + stride * q + width * k);
            }
            matrix += static_cast<size_t>(rows) * size;
        }
        const V flow = hn::Load(d, scaleOfFlow), potential = hn::Load(d, scaleOfPotential);
        const V Dx = hn::Set(d, static_cast<Number>(task.D[0])),
                Dy = hn::Set(d, static_cast<Number>(task.D[1])),
                Dz = hn::Set(d, static_cast<Number>(task.D[2]));
        for (int a = 0; a < size; a++) {
            const Number* out = task.out + static_cast<size_t>(stride) * a;
            const V sign = hn::Set(d, task.signs[a]);
            V v0 = hn::LoadU(d, out), v1 = hn::LoadU(d, out + width),
              v2 = hn::LoadU(d, out + 2 * width), v3 = hn::LoadU(d, out + 3 * width);
            // Refer the potential to the target's centre.
            v3 = hn::NegMulAdd(Dx, v0, hn::NegMulAdd(Dy, v1, hn::NegMulAdd(Dz, v2, v3)));
            const V f = hn::Mul(sign, flow);
            hn::StoreInterleaved4(hn::Mul(f, v0), hn::Mul(f, v1), hn::Mul(f, v2),
                                  hn::Mul(hn::Mul(sign, potential), v3), d, quads);
            for (int k = 0; k < count; k++)
                for (int q = 0; q < 4; q += quarter) {
                    Number* local = to[k] + 4 * columns * a + q;
                    hn::StoreU(hn::Add(hn::LoadU(four, local), hn::LoadU(four, quads + 4 * k + q)),
                               four, local);
                }
        }
        for (int k = 0; k < 4 * 16; k++) quads[k] = 0;
    }
}

void translateDoubles(const FarTask<double>& task) { translateLanes(task, Doubles()); }
void translateFloats(const FarTask<float>& task) { translateLanes(task, Floats()); }

/**
 * A pack of targets: positions relative to the centre of the leaf, and exact positions for pairs
 * that overlap.
 */
template <class Real>
struct NearTargets {
    Vector3<Real> place;
    Real radius, square, height;
    double x[16], y[16], z[16], a[16];
    HWY_INLINE NearTargets(const NearTask& task, int first, int end, int width) {
        typename Real::Scalar in[5][16];
        for (int lane = 0; lane < width; lane++) {
            const int i = HWY_MIN(first + lane, end - 1);
            x[lane] = task.x[i];
            y[lane] = task.y[i];
            z[lane] = task.z[i];
            a[lane] = task.radius[i];
            in[0][lane] = x[lane] - task.centre[0];
            in[1][lane] = y[lane] - task.centre[1];
            in[2][lane] = z[lane] - task.centre[2];
            in[3][lane] = a[lane];
            in[4][lane] = z[lane];
        }
        load(in[0], place.x);
        load(in[1], place.y);
        load(in[2], place.z);
        load(in[3], radius);
        load(in[4], height);
        square = radius * radius;
    }
    static HWY_INLINE void load(const double* from, Pack& to) { HWY_NAMESPACE::load(from, to); }
    static HWY_INLINE void load(const float* from, SinglePack& to) {
        to.v = hn::LoadU(Floats(), from);
    }
};

/** Pairs of which some overlap, in double precision. */
template <class Real>
HWY_NOINLINE PairMobility<Real> overlappingPairs(const NearTask& task,
                                                 const NearTargets<Real>& targets, int source) {
    return roundedPairs<Real>([&](int k) {
        const int lane = k * lanes(Pack(0.0));
        Pack x, y, z, a;
        load(targets.x + lane, x);
        load(targets.y + lane, y);
        load(targets.z + lane, z);
        load(targets.a + lane, a);
        const Vector3<Pack> r = {x - Pack(task.x[source]), y - Pack(task.y[source]),
                                 z - Pack(task.z[source])};
        return pairMobility(addedDot(r, r), a, Pack(task.radius[source]));
    });
}

/**
 * A source record has the position relative to the leaf's centre, radius, height, then force (and
 * torque) for each column.
 */
template <class Real, bool wall, int columns, bool targetTorque, bool sourceTorque>
HWY_INLINE void sumOverNear(const NearTask& task, const NearTargets<Real>& targets,
                            const typename Real::Scalar* source, const int* index, int first,
                            int end, Vector3<Real>* velocity, Vector3<Real>* omega) {
    const int own = 5, stride = own + (sourceTorque ? 6 : 3) * columns;
    for (int j = first; j < end; j++, source += stride) {
        const Vector3<Real> r = {targets.place.x - Real(source[0]),
                                 targets.place.y - Real(source[1]),
                                 targets.place.z - Real(source[2])};
        const Real a(source[3]), sum = targets.radius + a, contact2 = sum * sum,
                                 distance2 = addedDot(r, r);
        PairMobility<Real> m;
        if (HWY_UNLIKELY(!allGreater(distance2, contact2)))
            m = overlappingPairs(task, targets, index[j]);
        else
            m = farPairMobility(distance2, targets.square + a * a);
        Vector3<Real> force[columns], torque[columns];
        for (int c = 0; c < columns; c++) {
            const auto* from = source + own + (sourceTorque ? 6 : 3) * c;
            force[c] = {Real(from[0]), Real(from[1]), Real(from[2])};
            if (sourceTorque) torque[c] = {Real(from[3]), Real(from[4]), Real(from[5])};
        }
        const Vector3<Real>* ofSource = sourceTorque ? torque : nullptr;
        addPairVelocities<columns, targetTorque, sourceTorque>(m, r, force, ofSource, velocity,
                                                               omega);
        if (wall)
            addWallVelocities<columns, targetTorque, sourceTorque>(
                wallMobility(r, targets.height, Real(source[4]), targets.radius, a), force,
                ofSource, velocity, omega);
    }
}

HWY_INLINE void addToSum(const Pack& x, Pack* sum) { sum[0] = sum[0] + x; }
HWY_INLINE void addToSum(const SinglePack& x, Pack* sum) { addTo(x, sum); }

template <class Real, bool wall, int columns, bool targetTorque>
HWY_NOINLINE void sumOfPack(const NearTask& task, int first, int end, int numSpheres, int numAll) {
    // Sum at most this many terms in floats, then add the sum to doubles; longer sums would round
    // more.
    const int atATime = std::is_same<Real, Pack>::value ? 1 << 30 : 64;
    constexpr int packs = Real::packs;
    const int width = packs * lanes(Pack(0.0));
    const NearTargets<Real> targets(task, first, end, width);
    Pack sums[6 * columns][packs];
    for (auto& sum : sums)
        for (Pack& each : sum) each = Pack(0.0);
    const auto* source = reinterpret_cast<const typename Real::Scalar*>(task.space);
    for (int j = 0, next; j < numAll; j = next) {
        const bool spheres = j < numSpheres;
        const int limit = spheres ? numSpheres : numAll;
        next = limit - j > atATime ? j + atATime : limit;
        Vector3<Real> velocity[columns], omega[columns];
        for (int c = 0; c < columns; c++)
            velocity[c] = omega[c] = {Real(0.0), Real(0.0), Real(0.0)};
        if (spheres)
            sumOverNear<Real, wall, columns, targetTorque, true>(task, targets, source, task.index,
                                                                 j, next, velocity, omega);
        else
            sumOverNear<Real, wall, columns, targetTorque, false>(task, targets, source, task.index,
                                                                  j, next, velocity, omega);
        source += (next - j) * (5 + (spheres ? 6 : 3) * columns);
        for (int c = 0; c < columns; c++) {
            addToSum(velocity[c].x, sums[6 * c]);
            addToSum(velocity[c].y, sums[6 * c + 1]);
            addToSum(velocity[c].z, sums[6 * c + 2]);
            if (!targetTorque) continue;
            addToSum(omega[c].x, sums[6 * c + 3]);
            addToSum(omega[c].y, sums[6 * c + 4]);
            addToSum(omega[c].z, sums[6 * c + 5]);
        }
    }
    for (int k = 0; k < 6 * columns; k++) {
        if (!targetTorque && k % 6 > 2) continue;
        double out[16];
        for (int p = 0; p < packs; p++) store(sums[k][p], out + p * lanes(Pack(0.0)));
        for (int lane = 0; lane < width && first + lane < end; lane++)
            task.velocities[(first + lane) * static_cast<size_t>(6 * columns) + k] = out[lane];
    }
}

template <class Real, bool wall, int columns>
void sumNearOf(const NearTask& task) {
    // Spheres first, then blobs.
    auto* to = reinterpret_cast<typename Real::Scalar*>(task.space);
    int numAll = 0, numSpheres = 0;
    for (bool spheres : {true, false}) {
        for (int s = 0; s < task.numSources; s++) {
            const int* range = task.sources[s];
            for (int j = spheres ? range[0] : range[1]; j < (spheres ? range[1] : range[2]); j++) {
                *to++ = task.x[j] - task.centre[0];
                *to++ = task.y[j] - task.centre[1];
                *to++ = task.z[j] - task.centre[2];
                *to++ = task.radius[j];
                *to++ = task.z[j];
                for (int c = 0; c < columns; c++)
                    for (int k = 0; k < (spheres ? 6 : 3); k++)
                        *to++ = task.loads[j * static_cast<size_t>(6 * columns) + 6 * c + k];
                task.index[numAll++] = j;
            }
        }
        if (spheres) numSpheres = numAll;
    }
    const int width = Real::packs * lanes(Pack(0.0));
    for (int i = task.first; i < task.endSpheres; i += width)
        sumOfPack<Real, wall, columns, true>(task, i, task.endSpheres, numSpheres, numAll);
    for (int i = task.endSpheres; i < task.end; i += width)
        sumOfPack<Real, wall, columns, false>(task, i, task.end, numSpheres, numAll);
}

/** Velocities of the targets induced by the particles near them. */
void sumNear(const NearTask& task) {
    withFlags(
        [&](auto single, auto wall, auto two) {
            sumNearOf<std::conditional_t<single, SinglePack, Pack>, wall, two ? 2 : 1>(task);
        },
        task.single, task.hasWall, task.columns == 2);
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#include <algorithm>
#include <cmath>

using namespace std;
using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace RigidHIPlugin {

HWY_EXPORT(addToSlots);
HWY_EXPORT(viewSlots);
HWY_EXPORT(addShifted);
HWY_EXPORT(translateDoubles);
HWY_EXPORT(translateFloats);
HWY_EXPORT(sumNear);

namespace {

/** Fields for each column: f_x, f_y, f_z, g, and e E for sources above a wall. */
const int fieldsUp = 5, fieldsDown = 4;

int padded(int size, int to) { return (size + to - 1) / to * to; }

void translate(const FarTask<double>& task) { HWY_DYNAMIC_DISPATCH(translateDoubles)(task); }
void translate(const FarTask<float>& task) { HWY_DYNAMIC_DISPATCH(translateFloats)(task); }

/**
 * The parameters for an error, and the number of particles above which they take less time than the
 * sum over pairs. The largest errors that BenchmarkFastSum --errors found were 0.53 of the errors
 * in the table, relative to the velocities induced by random forces and torques, in clouds,
 * clusters, spherical shells and layers on a wall, of equal and unequal radii; TestFastSum checks
 * other scenes. The numbers of particles come from processor times of clouds, as if the sum over
 * pairs were twice as fast as it is.
 */
struct Row {
    double error;
    int fewest[2];  // particles, unbounded and above a wall
    FastSum::Accuracy accuracy;
};
const Row rows[] = {
    {1e-2, {6000, 4000}, {4, 0.68, 120, 2}},   {1e-3, {10000, 6000}, {6, 0.62, 200, 2}},
    {1e-4, {20000, 12000}, {8, 0.57, 300, 2}}, {1e-5, {30000, 20000}, {9, 0.48, 400, 2}},
    {1e-6, {60000, 40000}, {12, 0.5, 400, 1}},
};

}  // namespace

/**
 * Torques and images make near pairs slower, but pairs of cubes hardly slower. So dividing smaller
 * cubes pays off. The factors were measured on clouds at errors of 1e-2 to 1e-4.
 */
static int leafSizeFor(const HydrodynamicParticles& particles, bool hasWall, int leafSize) {
    const double ofImages = 0.7, ofTorques = 0.65;
    double number = 0;
    for (char torque : particles.hasTorque) number += torque;
    const double share = particles.size() > 0 ? number / particles.size() : 0;
    return lround(leafSize * (hasWall ? ofImages : 1) * (1 + share * (ofTorques - 1)));
}

const FastSum::Accuracy* FastSum::choose(double error, int numParticles, bool hasWall) {
    // The loosest row that suffices. A tolerance of 1e-6 may contain rounding errors, because it
    // may be a product of factors.
    const double rounding = 1e-12;
    for (const Row& row : rows)
        if (row.error <= error * (1 + rounding))
            return numParticles >= row.fewest[hasWall] ? &row.accuracy : nullptr;
    return nullptr;
}

template <class Number>
struct FastSum::Far {
    vector<Number> moments, locals;  // of cells and their images; of cells
    vector<Number> signs[8];
    map<array<int, 5>, vector<Number>> matrices;
    vector<const Number*> matrixOfClass;
};

/** The power of two closest to the radii. Divisions by it have no rounding errors. */
static double lengthFor(const vector<double>& radii) {
    if (radii.empty()) return 1;
    const auto extremes = minmax_element(radii.begin(), radii.end());
    return ldexp(1.0, lround((log2(*extremes.first) + log2(*extremes.second)) / 2));
}

FastSum::FastSum(const HydrodynamicParticles& particles, bool hasWall, const Accuracy& accuracy,
                 const ForRanges& forRanges)
    : particles(particles), hasWall(hasWall), length(lengthFor(particles.radii)),
      accuracy(accuracy), leafSize(leafSizeFor(particles, hasWall, accuracy.leafSize)),
      forRanges(forRanges), harmonics(accuracy.order) {}

FastSum::~FastSum() {}

template <>
FastSum::Far<float>& FastSum::far<float>() {
    if (!singleFar) singleFar = make_unique<Far<float>>();
    return *singleFar;
}
template <>
FastSum::Far<double>& FastSum::far<double>() {
    if (!doubleFar) doubleFar = make_unique<Far<double>>();
    return *doubleFar;
}

/** Call the task for ranges of about equal cost, so that all threads have about the same work. */
void FastSum::inParts(const vector<double>& costs, const function<void(int, int)>& task) const {
    if (costs.empty()) return;
    if (!forRanges) {
        task(0, costs.size());
        return;
    }
    const int parts = 512;
    vector<int> bounds(parts + 1, costs.size());
    double total = 0, sum = 0;
    for (double cost : costs) total += cost;
    int part = 0;
    for (size_t i = 0; i < costs.size(); i++) {
        while (part <= parts && sum >= total * part / parts) bounds[part++] = i;
        sum += costs[i];
    }
    bounds[0] = 0;
    bounds[parts] = costs.size();
    forRanges(parts, [&](int first, int end) {
        if (bounds[first] < bounds[end]) task(bounds[first], bounds[end]);
    });
}

void FastSum::moveTo(const vector<OpenMM::Vec3>& positions, const vector<double>& weights) {
    vector<OpenMM::Vec3> places = positions;
    for (OpenMM::Vec3& place : places) place /= length;
    vector<double> radii = particles.radii;
    for (double& a : radii) a /= length;
    tree.build(places, radii, particles.hasTorque, hasWall, {leafSize, accuracy.opening});
    displaceTo(positions, weights);
    const int count = positions.size();
    radius.resize(count);
    row.resize(count);
    for (int i = 0; i < count; i++) {
        const int p = tree.order[i];
        radius[i] = radii[p];
        row[i] = particles.firstRow[p];
    }
    numSpheres.assign(tree.cells.size(), 0);
    costsOfLeaves.assign(tree.leaves.size(), 0);
    for (size_t l = 0; l < tree.leaves.size(); l++) {
        const auto& leaf = tree.cells[tree.leaves[l]];
        for (int i = leaf.first; i < leaf.end; i++)
            numSpheres[tree.leaves[l]] += particles.hasTorque[tree.order[i]];
        double sources = 0;
        for (int k = tree.firstNear[l]; k < tree.firstNear[l + 1]; k++) {
            const auto& near = tree.cells[tree.near[k]];
            sources += near.end - near.first;
        }
        costsOfLeaves[l] = (leaf.end - leaf.first) * (sources + harmonics.size());
    }
    costsOfFar.assign(tree.cells.size(), 1);
    for (const auto& pair : tree.farPairs) costsOfFar[pair.target]++;
    shiftOfCell.assign(tree.cells.size(), nullptr);
    for (size_t c = 1; c < tree.cells.size(); c++) shiftOfCell[c] = &shiftOf(tree.cells[c]);
    if (accuracy.floats == 2)
        prepareFar<float>();
    else
        prepareFar<double>();
}

void FastSum::displaceTo(const vector<OpenMM::Vec3>& positions, const vector<double>& weights) {
    const int count = positions.size();
    for (auto* v : {&x, &y, &z, &weight}) v->resize(count);
    for (int i = 0; i < count; i++) {
        const int p = tree.order[i];
        x[i] = positions[p][0] / length;
        y[i] = positions[p][1] / length;
        z[i] = positions[p][2] / length;
        weight[i] = weights[p];
    }
}

/**
 * The matrix that gives R relative to the parent from R relative to the child, each in halves of
 * its own edge.
 */
const MatrixXd& FastSum::shiftOf(const ClusterTree::Cell& child) {
    const Vector3d d = (child.centre - tree.cells[child.parent].centre) / child.half;
    array<int, 3> key;
    for (int k = 0; k < 3; k++) key[k] = lround(d[k]);
    MatrixXd& matrix = shifts[key];
    if (matrix.size() == 0) {
        matrix = harmonics.shift(Vector3d(key[0], key[1], key[2]));
        for (int a = 0; a < matrix.rows(); a++) matrix.row(a) *= ldexp(1.0, -harmonics.degree(a));
    }
    return matrix;
}

template <class Number>
void FastSum::prepareFar() {
    Far<Number>& f = far<Number>();
    const int size = harmonics.size(), rows = FarTask<Number>::rowsAtOnce;
    for (int mirrored = 0; mirrored < 8; mirrored++)
        f.signs[mirrored].assign(harmonics.signs(mirrored).begin(),
                                 harmonics.signs(mirrored).end());
    // Keep matrices from one placement to the next, up to a limit. Drop those of images off the
    // lattice.
    const size_t most = 2000;
    if (f.matrices.size() > most) f.matrices.clear();
    for (auto i = f.matrices.begin(); i != f.matrices.end();)
        i = i->first[1] >= 0 ? f.matrices.erase(i) : next(i);
    f.matrixOfClass.clear();
    vector<pair<const ClusterTree::FarClass*, vector<Number>*>> wanted;
    for (const auto& of : tree.classes) {
        const auto known = f.matrices.emplace(of.key, vector<Number>());
        if (known.second) wanted.push_back({&of, &known.first->second});
        f.matrixOfClass.push_back(nullptr);
    }
    inParts(vector<double>(wanted.size(), 1), [&](int first, int end) {
        for (int w = first; w < end; w++) {
            const auto& of = *wanted[w].first;
            const MatrixXd T = harmonics.fromFar(of.D.cwiseAbs());
            const double ratio = ldexp(1.0, -of.key[0]);  // the target's edge over the source's
            vector<Number>& panels = *wanted[w].second;
            panels.assign(static_cast<size_t>(padded(size, rows)) * size, 0);
            for (int a = 0; a < size; a++)
                for (int b = 0; b < size; b++)
                    panels[(static_cast<size_t>(a / rows) * size + b) * rows + a % rows] =
                        T(a, b) * pow(ratio, harmonics.degree(a));
        }
    });
    for (size_t c = 0; c < tree.classes.size(); c++)
        f.matrixOfClass[c] = f.matrices[tree.classes[c].key].data();
}

/** The moments of a cell, from its children or, for a leaf, from its particles. */
void FastSum::gatherMoments(int c, int columns) {
    const auto& cell = tree.cells[c];
    const int size = harmonics.size(), fields = fieldsUp * columns;
    double* to = &up[static_cast<size_t>(size) * fields * c];
    fill(to, to + static_cast<size_t>(size) * fields, 0.0);
    if (!cell.isLeaf()) {
        vector<double> from(static_cast<size_t>(size) * fields),
            sum(static_cast<size_t>(size) * fields);
        vector<int> first(size, 0), end(size);
        for (int a = 0; a < size; a++)
            end[a] = (harmonics.degree(a) + 1) * (harmonics.degree(a) + 1);
        for (int child = cell.firstChild; child < cell.firstChild + cell.numChildren; child++) {
            const Vector3d d = (tree.cells[child].centre - cell.centre) / tree.cells[child].half;
            const double* in = &up[static_cast<size_t>(size) * fields * child];
            for (int b = 0; b < size * columns; b++) {
                const double* f = in + fieldsUp * b;
                double* shifted = from.data() + fieldsUp * b;
                for (int k = 0; k < 3; k++) shifted[k] = f[k];
                shifted[3] = 0.5 * (f[3] + d[0] * f[0] + d[1] * f[1] + d[2] * f[2]);
                shifted[4] = f[4];
            }
            const MatrixXd& C = *shiftOfCell[child];
            HWY_DYNAMIC_DISPATCH(addShifted)
            (size, C.data(), 1, size, first.data(), end.data(), fields, from.data(), to);
        }
        return;
    }
    const double h = cell.half;
    vector<double> R(size), sums(static_cast<size_t>(columns) * size * numSlots, 0.0);
    for (int j = cell.first; j < cell.end; j++) {
        const double r[3] = {(x[j] - cell.centre[0]) / h, (y[j] - cell.centre[1]) / h,
                             (z[j] - cell.centre[2]) / h};
        harmonics.basis(r[0], r[1], r[2], R.data());
        const double b2 = radius[j] * radius[j] / (h * h);
        for (int column = 0; column < columns; column++) {
            const double* F = &loads[6 * (static_cast<size_t>(columns) * j + column)];
            const double* T = F + 3;
            double w[numSlots];
            for (int k = 0; k < 3; k++) {
                w[Charge + k] = F[k];
                w[Torque + k] = 0.5 * T[k] / h;
                w[PotentialDipole + k] = b2 / 3 * F[k];
                w[WallDipole + k] = 2 * z[j] / h * F[k];
                w[WallQuadrupole + k] = 2 * b2 / 3 * F[k];
            }
            w[PotentialCharge] = r[0] * F[0] + r[1] * F[1] + r[2] * F[2];
            w[PotentialDipole] += 0.5 * (r[1] * T[2] - r[2] * T[1]) / h;
            w[PotentialDipole + 1] += 0.5 * (r[2] * T[0] - r[0] * T[2]) / h;
            w[PotentialDipole + 2] += 0.5 * (r[0] * T[1] - r[1] * T[0]) / h;
            w[WallDipole] += T[1] / h;  // T x e
            w[WallDipole + 1] -= T[0] / h;
            HWY_DYNAMIC_DISPATCH(addToSlots)
            (size, R.data(), w, &sums[static_cast<size_t>(column) * size * numSlots]);
        }
    }
    vector<double> slots[numSlots], dipoles(size);
    for (int column = 0; column < columns; column++) {
        for (int s = 0; s < numSlots; s++) {
            slots[s].resize(size);
            for (int a = 0; a < size; a++)
                slots[s][a] = sums[(static_cast<size_t>(column) * size + a) * numSlots + s];
        }
        double* moments = to + fieldsUp * column;
        for (int a = 0; a < size; a++)
            for (int k = 0; k < 4; k++) moments[a * fields + k] = slots[Charge + k][a];
        for (int k = 0; k < 3; k++) {
            // (T x D)_k = T_i D_j - T_j D_i
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            harmonics.addDerivativeOfMoments(j, 1, slots[Torque + i].data(), moments + k, fields);
            harmonics.addDerivativeOfMoments(i, -1, slots[Torque + j].data(), moments + k, fields);
            harmonics.addDerivativeOfMoments(k, 1, slots[PotentialDipole + k].data(), moments + 3,
                                             fields);
            if (!hasWall) continue;
            dipoles = slots[WallDipole + k];
            harmonics.addDerivativeOfMoments(2, 1, slots[WallQuadrupole + k].data(),
                                             dipoles.data());
            harmonics.addDerivativeOfMoments(k, 1, dipoles.data(), moments + 4, fields);
        }
    }
}

/**
 * Add to the velocities of a leaf's particles the values of its local expansion, which already
 * includes the expansions of the cells around the leaf.
 */
void FastSum::shareLocal(int c, int columns) {
    const auto& cell = tree.cells[c];
    const int size = harmonics.size(), fields = fieldsDown * columns;
    const double* local = &down[static_cast<size_t>(size) * fields * c];
    const double h = cell.half;
    vector<double> R(size), coefficients(static_cast<size_t>(columns) * size * numSlots, 0.0);
    vector<double> f[4], gradient[3][3], of(size), divergence(size);
    for (int column = 0; column < columns; column++) {
        for (int k = 0; k < 4; k++) {
            f[k].resize(size);
            for (int a = 0; a < size; a++) f[k][a] = local[a * fields + fieldsDown * column + k];
        }
        double* to = &coefficients[static_cast<size_t>(column) * size * numSlots];
        const auto set = [&](int slot, const vector<double>& values) {
            for (int a = 0; a < size; a++) to[a * numSlots + slot] += values[a];
        };
        fill(divergence.begin(), divergence.end(), 0.0);
        for (int k = 0; k < 3; k++) {
            set(Flow + k, f[k]);
            harmonics.derivativeOfLocal(k, f[3].data(), of.data());
            set(Flow + k, of);
            for (int i = 0; i < 3; i++) {
                harmonics.derivativeOfLocal(i, f[k].data(), of.data());
                set(Gradient + 3 * k + i, of);
                if (i == k)
                    for (int a = 0; a < size; a++) divergence[a] += of[a];
            }
        }
        for (int k = 0; k < 3; k++) {
            harmonics.derivativeOfLocal(k, divergence.data(), of.data());
            set(GradientOfDivergence + k, of);
        }
    }
    for (int i = cell.first; i < cell.end; i++) {
        const double r[3] = {(x[i] - cell.centre[0]) / h, (y[i] - cell.centre[1]) / h,
                             (z[i] - cell.centre[2]) / h};
        harmonics.basis(r[0], r[1], r[2], R.data());
        const double a2 = radius[i] * radius[i] / (3 * h * h);
        for (int column = 0; column < columns; column++) {
            double v[numSlots];
            HWY_DYNAMIC_DISPATCH(viewSlots)
            (size, R.data(), &coefficients[static_cast<size_t>(column) * size * numSlots], v);
            double* to = &results[6 * (static_cast<size_t>(columns) * i + column)];
            for (int k = 0; k < 3; k++) {
                const int m = (k + 1) % 3, n = (k + 2) % 3;
                to[k] += v[Flow + k] - r[0] * v[Gradient + k] - r[1] * v[Gradient + 3 + k] -
                         r[2] * v[Gradient + 6 + k] - a2 * v[GradientOfDivergence + k];
                to[3 + k] += (v[Gradient + 3 * n + m] - v[Gradient + 3 * m + n]) / h;
            }
        }
    }
}

template <class Number>
void FastSum::sumFar(int columns) {
    Far<Number>& f = far<Number>();
    const int size = harmonics.size(), numCells = tree.cells.size();
    const size_t ofUp = static_cast<size_t>(fieldsUp) * columns * size,
                 ofDown = static_cast<size_t>(fieldsDown) * columns * size;
    up.resize(ofUp * numCells);
    f.moments.resize(ofDown * numCells * (hasWall ? 2 : 1));
    for (int level = static_cast<int>(tree.firstOfLevel.size()) - 2; level >= 0; level--) {
        const int firstCell = tree.firstOfLevel[level];
        inParts(vector<double>(tree.firstOfLevel[level + 1] - firstCell, 1),
                [&](int first, int end) {
                    for (int c = firstCell + first; c < firstCell + end; c++)
                        gatherMoments(c, columns);
                });
    }
    inParts(vector<double>(numCells, 1), [&](int first, int end) {
        const vector<double>& mirror = harmonics.signs(4);
        for (int c = first; c < end; c++) {
            const bool onWall = tree.cells[c].onWall;
            const double height = tree.cells[c].centre[2] / tree.cells[c].half;
            const double* from = &up[ofUp * c];
            Number* to = &f.moments[ofDown * c];
            for (int a = 0; a < size; a++)
                for (int column = 0; column < columns;
                     column++, from += fieldsUp, to += fieldsDown) {
                    for (int k = 0; k < 4; k++) to[k] = from[k];
                    if (!hasWall) continue;
                    const double image[4] = {
                        -mirror[a] * from[0], -mirror[a] * from[1], mirror[a] * (from[4] - from[2]),
                        mirror[a] * (height * (from[4] - 2 * from[2]) - from[3])};
                    Number* imageTo = onWall ? to : to + ofDown * numCells;
                    for (int k = 0; k < 4; k++) imageTo[k] = image[k] + (onWall ? from[k] : 0);
                }
        }
    });
    f.locals.resize(ofDown * numCells);
    inParts(costsOfFar, [&](int firstTarget, int endTarget) {
        fill(f.locals.begin() + ofDown * firstTarget, f.locals.begin() + ofDown * endTarget,
             Number(0));
        const int rows = FarTask<Number>::rowsAtOnce;
        vector<Number> in(static_cast<size_t>(64) * size),
            out(static_cast<size_t>(64) * padded(size, rows));
        vector<double> halves(2 * numCells);
        for (int c = 0; c < numCells; c++) halves[c] = halves[numCells + c] = tree.cells[c].half;
        for (size_t n = 0; n < tree.classes.size(); n++) {
            const auto& of = tree.classes[n];
            const auto from = tree.farPairs.begin() + of.first, to = tree.farPairs.begin() + of.end;
            const auto before = [](const ClusterTree::FarPair& pair, int target) {
                return pair.target < target;
            };
            FarTask<Number> task;
            task.first = lower_bound(from, to, firstTarget, before) - tree.farPairs.begin();
            task.end = lower_bound(from, to, endTarget, before) - tree.farPairs.begin();
            if (task.first == task.end) continue;
            task.size = size;
            task.columns = columns;
            task.matrix = f.matrixOfClass[n];
            task.signs = f.signs[of.mirrored].data();
            for (int k = 0; k < 3; k++) task.D[k] = of.D[k];
            task.pairs = tree.farPairs.data();
            task.half = halves.data();
            task.moments = f.moments.data();
            task.locals = f.locals.data();
            task.in = in.data();
            task.out = out.data();
            translate(task);
        }
    });
    down.resize(ofDown * numCells);
    vector<int> first(size), end(size, size);
    for (int b = 0; b < size; b++) first[b] = harmonics.degree(b) * harmonics.degree(b);
    for (size_t level = 0; level + 1 < tree.firstOfLevel.size(); level++) {
        const int firstCell = tree.firstOfLevel[level];
        inParts(
            vector<double>(tree.firstOfLevel[level + 1] - firstCell, 1), [&](int begin, int stop) {
                vector<double> shifted(ofDown);
                for (int c = firstCell + begin; c < firstCell + stop; c++) {
                    const Number* own = &f.locals[ofDown * c];
                    double* to = &down[ofDown * c];
                    for (size_t k = 0; k < ofDown; k++) to[k] = own[k];
                    const auto& cell = tree.cells[c];
                    if (cell.parent < 0) continue;
                    const Vector3d d = (cell.centre - tree.cells[cell.parent].centre) / cell.half;
                    fill(shifted.begin(), shifted.end(), 0.0);
                    HWY_DYNAMIC_DISPATCH(addShifted)
                    (size, shiftOfCell[c]->data(), size, 1, first.data(), end.data(),
                     fieldsDown * columns, &down[ofDown * cell.parent], shifted.data());
                    for (int b = 0; b < size * columns; b++) {
                        const double* in = &shifted[fieldsDown * b];
                        for (int k = 0; k < 3; k++) to[fieldsDown * b + k] += in[k];
                        to[fieldsDown * b + 3] +=
                            2 * in[3] - d[0] * in[0] - d[1] * in[1] - d[2] * in[2];
                    }
                }
            });
    }
}

template <class Number>
void FastSum::multiply(const MatrixXd& forces, int firstColumn, int columns, double scale,
                       MatrixXd& velocities) {
    const int count = x.size();
    loads.resize(static_cast<size_t>(6) * columns * count);
    results.resize(loads.size());
    // Forces, and torques over the unit of length.
    const auto load = [&](int i, int k, int c) {
        return forces(row[i] + k, firstColumn + c) / (k < 3 ? 1 : length);
    };
    const auto numRows = [&](int i) { return particles.hasTorque[tree.order[i]] ? 6 : 3; };
    double largest = 0;
    for (int i = 0; i < count; i++)
        for (int c = 0; c < columns; c++)
            for (int k = 0; k < numRows(i); k++) largest = max(largest, abs(load(i, k, c)));
    const double unit = largest > 0 && isfinite(largest) ? largest : 1;
    for (int i = 0; i < count; i++)
        for (int c = 0; c < columns; c++)
            for (int k = 0; k < 6; k++)
                loads[6 * (static_cast<size_t>(columns) * i + c) + k] =
                    k < numRows(i) ? weight[i] * (load(i, k, c) / unit) : 0;
    // Floats round positions in near cubes by 1e-7 of three halves of an edge. For particles in
    // contact this must be below 1e-5 (if far pairs use floats, too) or 1e-6 of their distance.
    const double inRadii = accuracy.floats == 2 ? 200 : accuracy.floats == 1 ? 20 : 0;
    const double largestHalf = inRadii * *min_element(radius.begin(), radius.end());
    const bool hasFar = !tree.farPairs.empty();
    if (hasFar) sumFar<Number>(columns);
    inParts(costsOfLeaves, [&](int firstLeaf, int endLeaf) {
        vector<double> space;
        vector<int> index;
        vector<array<int, 3>> ranges;
        for (int l = firstLeaf; l < endLeaf; l++) {
            const int c = tree.leaves[l];
            const auto& leaf = tree.cells[c];
            ranges.clear();
            int numSources = 0;
            for (int k = tree.firstNear[l]; k < tree.firstNear[l + 1]; k++) {
                const auto& near = tree.cells[tree.near[k]];
                ranges.push_back({near.first, near.first + numSpheres[tree.near[k]], near.end});
                numSources += near.end - near.first;
            }
            if (static_cast<int>(index.size()) < numSources) {
                index.resize(numSources);
                space.resize(static_cast<size_t>(18) * numSources);
            }
            NearTask task;
            task.x = x.data();
            task.y = y.data();
            task.z = z.data();
            task.radius = radius.data();
            task.first = leaf.first;
            task.endSpheres = leaf.first + numSpheres[c];
            task.end = leaf.end;
            task.sources = reinterpret_cast<const int(*)[3]>(ranges.data());
            task.numSources = ranges.size();
            task.hasWall = hasWall;
            task.single = leaf.half <= largestHalf;
            // Differences of floats need small numbers. Differences of doubles must be the same in
            // packs with and without overlaps.
            for (int k = 0; k < 3; k++) task.centre[k] = task.single ? leaf.centre[k] : 0;
            task.columns = columns;
            task.loads = loads.data();
            task.velocities = results.data();
            task.space = space.data();
            task.index = index.data();
            HWY_DYNAMIC_DISPATCH(sumNear)(task);
            if (hasFar) shareLocal(c, columns);
            for (int i = leaf.first; i < leaf.end; i++)
                for (int column = 0; column < columns; column++)
                    for (int k = 0; k < (i < task.endSpheres ? 6 : 3); k++)
                        velocities(row[i] + k, firstColumn + column) =
                            scale / (k < 3 ? length : length * length) * unit * weight[i] *
                            results[6 * (static_cast<size_t>(columns) * i + column) + k];
        }
    });
}

void FastSum::apply(const MatrixXd& forces, double scale, MatrixXd& velocities) {
    velocities.resize(particles.numRows, forces.cols());
    for (int column = 0; column < forces.cols(); column += 2) {
        const int columns = min<int>(2, forces.cols() - column);
        if (accuracy.floats == 2)
            multiply<float>(forces, column, columns, scale, velocities);
        else
            multiply<double>(forces, column, columns, scale, velocities);
    }
}

size_t FastSum::getMemory() const {
    const auto bytes = [](const auto& v) { return v.capacity() * sizeof(v[0]); };
    size_t total = bytes(up) + bytes(down) + bytes(loads) + bytes(results) + bytes(tree.farPairs) +
                   bytes(tree.near) + bytes(tree.cells);
    const auto ofFar = [&](const auto& far) {
        if (!far) return;
        total += bytes(far->moments) + bytes(far->locals);
        for (const auto& matrix : far->matrices) total += bytes(matrix.second);
    };
    ofFar(singleFar);
    ofFar(doubleFar);
    return total;
}

}  // namespace RigidHIPlugin

#endif
