// Spreading, transforming, solving and averaging on a grid, compiled once for each instruction set,
// and the order in which slabs pass through these steps.

#include "simd/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/models/forcecoupling/CpuGridFluid.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include <algorithm>
#include <cstring>

#include "hwy/cache_control.h"
#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/forcecoupling/FourierPlan.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

#ifndef RIGIDHI_CPU_GRID_FLUID_LOOPS_
#define RIGIDHI_CPU_GRID_FLUID_LOOPS_
namespace RigidHIPlugin {

const int slabWidth = GridStencils::slabWidth;
/** Numbers for a mode of all planes of a slab, real and imaginary parts alternating. */
const int modeWidth = 2 * slabWidth;
/**
 * Modes along z whose columns along y are gathered at once. The pieces of rows are then long enough
 * for efficient memory access.
 */
const int modesAtOnce = 8;
/** Numbers of the averages over a slice: a velocity and an angular velocity, or a gradient. */
const int numbersOfPart = 9;

/**
 * How a grid is laid out in memory.
 *
 * A mirrored grid has the rows between the walls, and the outer rows beyond the walls that stencils
 * reach, which are reflections of inner rows.
 */
struct GridLayout {
    GridShape shape;
    int numSlabs = 0;   // along x
    int numRows = 0;    // along y, without outer ones; a mirrored grid has as many modes along y
    int reach = 0;      // number of outer rows on each side
    int numModes = 0;   // kz from 0 on, without the Nyquist index
    int rowLength = 0;  // nodes of a row, or twice its modes

    GridLayout() {}
    GridLayout(const GridStencils& stencils) : shape(stencils.getShape()) {
        const std::array<int, 3>& n = shape.size;
        numSlabs = GridStencils::slabsOf(shape);
        numRows = shape.numRows();
        // Half of a stencil is on each side of the centre, which is between the walls.
        if (shape.mirrored) reach = std::min(numRows, stencils.largestWidth(1) / 2);
        numModes = (n[2] + 1) / 2;
        // Stencils that cross the end of a row go on beyond the end.
        rowLength = std::max(n[2] + stencils.largestWidth(2), 2 * numModes);
        rowLength += rowLength % 2;  // whole cache lines in both precisions
    }
    size_t rowNumbers() const { return (size_t)rowLength * slabWidth; }
    /**
     * Rows in memory: those of the grid, the outer ones above, the outer ones below. If stencils
     * are so long that the outer rows of both sides meet, these are all rows of the period.
     */
    int storedRows() const { return std::min(shape.size[1], numRows + 2 * reach); }
    /** The index in memory of a row of the period. */
    int place(int y) const {
        while (y >= shape.size[1]) y -= shape.size[1];
        return y < shape.size[1] - reach ? y : y - (shape.size[1] - storedRows());
    }
    /**
     * Call visit(row, outer) with the indices of outer rows and of the rows that they are
     * reflections of.
     */
    template <class Visit>
    void forOuterRows(const Visit& visit) const {
        for (int i = 0; i < reach; i++) {
            visit(numRows - 1 - i, place(numRows + i));
            // Where the outer rows meet, the row was already visited as one above.
            if (shape.size[1] - 1 - i >= numRows + reach) visit(i, place(shape.size[1] - 1 - i));
        }
    }
    size_t slabNumbers() const { return storedRows() * rowNumbers(); }
    /** A column of modes along x, with padding to whole slabs. They lie one after the other. */
    size_t columnNumbers() const { return (size_t)numSlabs * modeWidth; }
    size_t column(int y, int z) const { return ((size_t)y * numModes + z) * columnNumbers(); }
    size_t modeNumbers() const { return column(numRows, 0); }
};

/**
 * A slab of nodes: for each component, rows along z one after the other; for each node, the planes
 * of the slab.
 */
template <typename T>
struct GridSlab {
    T* values[3];
    T* row(const GridLayout& layout, int component, int y) const {
        return atPlace(layout, component, layout.place(y));
    }
    T* atPlace(const GridLayout& layout, int component, int place) const {
        return values[component] + place * layout.rowNumbers();
    }
};

/** The memory of one thread. */
template <typename T>
struct GridScratch {
    AlignedArrayOf<T> slab, columns, transformed, noise;
    AlignedArrayOf<T> channels;  // columns of all channels and their sum
    GridSeconds seconds;
};

/** The transforms there and back. */
template <typename T>
struct GridPlans {
    FourierPlan<T> there, back;
};

/** The data that all threads share while they work on one column of forces or one field. */
template <typename T>
struct GridWork {
    const GridLayout& layout;
    const GridPlans<T>* plans;  // along each axis
    T* modes[3];
    const T *kx, *keepsX;  // wave numbers of each x, and 0 for the Nyquist index and padding, else
                           // 1; each twice
    const T* halfTurns;    // for a mirrored grid, cos and sin of pi m/(2 rows) for each ky
    bool streams;          // whether modes are too many for caches
};

/** A channel, with its own modes. */
template <typename T>
struct ChannelWork {
    T* modes[3];
    const GridFactors* factors;
    bool ofTorques;
};

}  // namespace RigidHIPlugin
#endif

HWY_BEFORE_NAMESPACE();
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/** A pack of a slab's planes. */
template <typename T>
using SlabLanes = HWY_CAPPED(T, slabWidth);

// ---- Between particles and nodes

/** Weights of a slice's planes, times a factor, in the precision of the grid. */
template <typename T>
struct PlaneWeights {
    HWY_ALIGN T numbers[slabWidth];
    PlaneWeights(const double* weights, double factor) {
        for (int i = 0; i < slabWidth; i++) numbers[i] = static_cast<T>(factor * weights[i]);
    }
    HWY_INLINE hn::Vec<SlabLanes<T> > pack(int lane) const {
        return hn::Load(SlabLanes<T>(), numbers + lane);
    }
};

/** Add the forces of a particle to one of the slabs that it reaches. */
template <typename T>
void spreadSlice(const GridStencils& stencils, const GridStencils::Slice& slice, const double* F,
                 const GridLayout& layout, const GridSlab<T>& slab) {
    typedef GridStencils Weights;
    const SlabLanes<T> d;
    const int width = hn::Lanes(d), p = slice.particle;
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force) + slice.offset,
                 *y = stencils.weightsOf(p, 1, Weights::Force),
                 *z = stencils.weightsOf(p, 2, Weights::Force);
    const bool hasTorque = stencils.getParticles().hasTorque[p];
    const PlaneWeights<T> fx(x, F[0]), fy(x, F[1]), fz(x, F[2]);
    if (!hasTorque) {
        for (int j = 0; j < s.width[1]; j++) {
            const GridStencils::Range range = stencils.nodesOf(slice, j);
            if (range.begin == range.end) continue;
            T *u = slab.row(layout, 0, s.first[1] + j), *v = slab.row(layout, 1, s.first[1] + j),
              *w = slab.row(layout, 2, s.first[1] + j);
            for (int lane = 0; lane < slabWidth; lane += width) {
                const auto a = fx.pack(lane), b = fy.pack(lane), c = fz.pack(lane);
                for (int k = range.begin; k < range.end; k++) {
                    const size_t at = (size_t)(s.first[2] + k) * slabWidth + lane;
                    const auto weight = hn::Set(d, static_cast<T>(y[j] * z[k]));
                    hn::Store(hn::MulAdd(a, weight, hn::Load(d, u + at)), d, u + at);
                    hn::Store(hn::MulAdd(b, weight, hn::Load(d, v + at)), d, v + at);
                    hn::Store(hn::MulAdd(c, weight, hn::Load(d, w + at)), d, w + at);
                }
            }
        }
        return;
    }
    // grad(Theta) x T/2, Theta = tx ty tz.
    const double *tx = stencils.weightsOf(p, 0, Weights::Torque) + slice.offset,
                 *gx = stencils.weightsOf(p, 0, Weights::TorqueSlope) + slice.offset;
    const double *ty = stencils.weightsOf(p, 1, Weights::Torque),
                 *gy = stencils.weightsOf(p, 1, Weights::TorqueSlope),
                 *tz = stencils.weightsOf(p, 2, Weights::Torque),
                 *gz = stencils.weightsOf(p, 2, Weights::TorqueSlope);
    const double* torque = F + 3;
    const PlaneWeights<T> plainX(tx, 0.5 * torque[0]), plainY(tx, 0.5 * torque[1]),
        plainZ(tx, 0.5 * torque[2]), slopeY(gx, 0.5 * torque[1]), slopeZ(gx, 0.5 * torque[2]);
    for (int j = 0; j < s.width[1]; j++) {
        const GridStencils::Range range = stencils.nodesOf(slice, j);
        if (range.begin == range.end) continue;
        T *u = slab.row(layout, 0, s.first[1] + j), *v = slab.row(layout, 1, s.first[1] + j),
          *w = slab.row(layout, 2, s.first[1] + j);
        for (int lane = 0; lane < slabWidth; lane += width) {
            const auto a = fx.pack(lane), b = fy.pack(lane), c = fz.pack(lane);
            const auto tX = plainX.pack(lane), tY = plainY.pack(lane), tZ = plainZ.pack(lane),
                       gY = slopeY.pack(lane), gZ = slopeZ.pack(lane);
            for (int k = range.begin; k < range.end; k++) {
                const size_t at = (size_t)(s.first[2] + k) * slabWidth + lane;
                const auto weight = hn::Set(d, static_cast<T>(y[j] * z[k])),
                           alongY = hn::Set(d, static_cast<T>(gy[j] * tz[k])),
                           alongZ = hn::Set(d, static_cast<T>(ty[j] * gz[k])),
                           plain = hn::Set(d, static_cast<T>(ty[j] * tz[k]));
                const auto toU = hn::NegMulAdd(tY, alongZ,
                                               hn::MulAdd(tZ, alongY, hn::Load(d, u + at))),
                           toV = hn::NegMulAdd(gZ, plain,
                                               hn::MulAdd(tX, alongZ, hn::Load(d, v + at))),
                           toW = hn::NegMulAdd(tX, alongY,
                                               hn::MulAdd(gY, plain, hn::Load(d, w + at)));
                hn::Store(hn::MulAdd(a, weight, toU), d, u + at);
                hn::Store(hn::MulAdd(b, weight, toV), d, v + at);
                hn::Store(hn::MulAdd(c, weight, toW), d, w + at);
            }
        }
    }
}

/** The sum over planes of the weights times the sums of each plane. */
template <typename T>
HWY_INLINE double overPlanes(const double* weights, const T* sums) {
    double sum = 0;
    for (int i = 0; i < slabWidth; i++) sum += weights[i] * sums[i];
    return sum;
}

/**
 * The transpose of spreadSlice(): the contribution of a slice to the velocities of its particle.
 */
template <typename T>
void averageSlice(const GridStencils& stencils, const GridStencils::Slice& slice,
                  const GridLayout& layout, const GridSlab<T>& slab, double* V) {
    typedef GridStencils Weights;
    const SlabLanes<T> d;
    const int width = hn::Lanes(d), p = slice.particle;
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force) + slice.offset,
                 *y = stencils.weightsOf(p, 1, Weights::Force),
                 *z = stencils.weightsOf(p, 2, Weights::Force);
    const bool hasTorque = stencils.getParticles().hasTorque[p];
    HWY_ALIGN T sums[8][slabWidth];
    for (int lane = 0; lane < slabWidth; lane += width) {
        auto sum_u = hn::Zero(d), sum_v = hn::Zero(d), sum_w = hn::Zero(d);
        for (int j = 0; j < s.width[1]; j++) {
            const GridStencils::Range range = stencils.nodesOf(slice, j);
            const T *u = slab.row(layout, 0, s.first[1] + j) + lane,
                    *v = slab.row(layout, 1, s.first[1] + j) + lane,
                    *w = slab.row(layout, 2, s.first[1] + j) + lane;
            auto row_u = hn::Zero(d), row_v = hn::Zero(d), row_w = hn::Zero(d);
            for (int k = range.begin; k < range.end; k++) {
                const size_t at = (size_t)(s.first[2] + k) * slabWidth;
                const auto weight = hn::Set(d, static_cast<T>(z[k]));
                row_u = hn::MulAdd(weight, hn::Load(d, u + at), row_u);
                row_v = hn::MulAdd(weight, hn::Load(d, v + at), row_v);
                row_w = hn::MulAdd(weight, hn::Load(d, w + at), row_w);
            }
            const auto weight = hn::Set(d, static_cast<T>(y[j]));
            sum_u = hn::MulAdd(weight, row_u, sum_u);
            sum_v = hn::MulAdd(weight, row_v, sum_v);
            sum_w = hn::MulAdd(weight, row_w, sum_w);
        }
        hn::Store(sum_u, d, sums[0] + lane);
        hn::Store(sum_v, d, sums[1] + lane);
        hn::Store(sum_w, d, sums[2] + lane);
    }
    for (int c = 0; c < 3; c++) V[c] = overPlanes(x, sums[c]);
    if (!hasTorque) return;
    const double *tx = stencils.weightsOf(p, 0, Weights::Torque) + slice.offset,
                 *gx = stencils.weightsOf(p, 0, Weights::TorqueSlope) + slice.offset;
    const double *ty = stencils.weightsOf(p, 1, Weights::Torque),
                 *gy = stencils.weightsOf(p, 1, Weights::TorqueSlope),
                 *tz = stencils.weightsOf(p, 2, Weights::Torque),
                 *gz = stencils.weightsOf(p, 2, Weights::TorqueSlope);
    for (int lane = 0; lane < slabWidth; lane += width) {
        // Sums of: v along z less w along y; u along z and along y; v and w without slopes.
        auto curl = hn::Zero(d), u_z = hn::Zero(d), u_y = hn::Zero(d), v_plain = hn::Zero(d),
             w_plain = hn::Zero(d);
        for (int j = 0; j < s.width[1]; j++) {
            const GridStencils::Range range = stencils.nodesOf(slice, j);
            const T *u = slab.row(layout, 0, s.first[1] + j) + lane,
                    *v = slab.row(layout, 1, s.first[1] + j) + lane,
                    *w = slab.row(layout, 2, s.first[1] + j) + lane;
            for (int k = range.begin; k < range.end; k++) {
                const size_t at = (size_t)(s.first[2] + k) * slabWidth;
                const auto alongY = hn::Set(d, static_cast<T>(gy[j] * tz[k])),
                           alongZ = hn::Set(d, static_cast<T>(ty[j] * gz[k])),
                           plain = hn::Set(d, static_cast<T>(ty[j] * tz[k]));
                const auto uk = hn::Load(d, u + at), vk = hn::Load(d, v + at),
                           wk = hn::Load(d, w + at);
                curl = hn::NegMulAdd(alongY, wk, hn::MulAdd(alongZ, vk, curl));
                u_z = hn::MulAdd(alongZ, uk, u_z);
                u_y = hn::MulAdd(alongY, uk, u_y);
                v_plain = hn::MulAdd(plain, vk, v_plain);
                w_plain = hn::MulAdd(plain, wk, w_plain);
            }
        }
        hn::Store(curl, d, sums[0] + lane);
        hn::Store(u_z, d, sums[1] + lane);
        hn::Store(u_y, d, sums[2] + lane);
        hn::Store(v_plain, d, sums[3] + lane);
        hn::Store(w_plain, d, sums[4] + lane);
    }
    V[3] = 0.5 * overPlanes(tx, sums[0]);
    V[4] = 0.5 * (overPlanes(gx, sums[4]) - overPlanes(tx, sums[1]));
    V[5] = 0.5 * (overPlanes(tx, sums[2]) - overPlanes(gx, sums[3]));
}

/** Minus the sums with the slopes of the force envelope, which are nine numbers. */
template <typename T>
void averageGradientSlice(const GridStencils& stencils, const GridStencils::Slice& slice,
                          const GridLayout& layout, const GridSlab<T>& slab, double* gradients) {
    typedef GridStencils Weights;
    const SlabLanes<T> d;
    const int width = hn::Lanes(d), p = slice.particle;
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force) + slice.offset,
                 *gx = stencils.weightsOf(p, 0, Weights::ForceSlope) + slice.offset;
    const double *y = stencils.weightsOf(p, 1, Weights::Force),
                 *gy = stencils.weightsOf(p, 1, Weights::ForceSlope),
                 *z = stencils.weightsOf(p, 2, Weights::Force),
                 *gz = stencils.weightsOf(p, 2, Weights::ForceSlope);
    HWY_ALIGN T sums[3][slabWidth];
    for (int a = 0; a < 3; a++) {
        for (int lane = 0; lane < slabWidth; lane += width) {
            auto along_x = hn::Zero(d), along_y = hn::Zero(d), along_z = hn::Zero(d);
            for (int j = 0; j < s.width[1]; j++) {
                const GridStencils::Range range = stencils.nodesOf(slice, j);
                const T* u = slab.row(layout, a, s.first[1] + j) + lane;
                auto plain = hn::Zero(d), sloped = hn::Zero(d);
                for (int k = range.begin; k < range.end; k++) {
                    const auto uk = hn::Load(d, u + (size_t)(s.first[2] + k) * slabWidth);
                    plain = hn::MulAdd(hn::Set(d, static_cast<T>(z[k])), uk, plain);
                    sloped = hn::MulAdd(hn::Set(d, static_cast<T>(gz[k])), uk, sloped);
                }
                const auto own = hn::Set(d, static_cast<T>(y[j]));
                along_x = hn::MulAdd(own, plain, along_x);
                along_y = hn::MulAdd(hn::Set(d, static_cast<T>(gy[j])), plain, along_y);
                along_z = hn::MulAdd(own, sloped, along_z);
            }
            hn::Store(along_x, d, sums[0] + lane);
            hn::Store(along_y, d, sums[1] + lane);
            hn::Store(along_z, d, sums[2] + lane);
        }
        gradients[3 * a] = -overPlanes(gx, sums[0]);
        gradients[3 * a + 1] = -overPlanes(x, sums[1]);
        gradients[3 * a + 2] = -overPlanes(x, sums[2]);
    }
}

// ---- Rows along z: two neighbouring planes are the real and imaginary parts of one complex row

/** Transform the nodes of a row to its modes, which are twice as large as those of the field. */
template <typename T>
void rowThere(const GridWork<T>& work, T* row, GridScratch<T>& scratch) {
    const int n = work.layout.shape.size[2];
    T* const both = scratch.columns.data();
    work.plans[2].there(row, both);
    for (int k = 0; k < work.layout.numModes; k++) {
        const T *z = both + (size_t)k * slabWidth,
                *mirrored = both + (size_t)(k == 0 ? 0 : n - k) * slabWidth;
        T* to = row + (size_t)k * modeWidth;
        for (int i = 0; i < slabWidth; i += 2) {
            to[2 * i] = z[i] + mirrored[i];
            to[2 * i + 1] = z[i + 1] - mirrored[i + 1];
            to[2 * i + 2] = z[i + 1] + mirrored[i + 1];
            to[2 * i + 3] = mirrored[i] - z[i];
        }
    }
}

/** Transform the modes of a row to its nodes, with copies beyond its end for stencils. */
template <typename T>
void rowBack(const GridWork<T>& work, T* row, GridScratch<T>& scratch) {
    const int n = work.layout.shape.size[2];
    T* const both = scratch.columns.data();
    for (int i = 0; i < slabWidth; i++) both[i] = row[2 * i];  // the first mode is real
    for (int k = 1; k < work.layout.numModes; k++) {
        const T* from = row + (size_t)k * modeWidth;
        T *z = both + (size_t)k * slabWidth, *mirrored = both + (size_t)(n - k) * slabWidth;
        for (int i = 0; i < slabWidth; i += 2) {
            z[i] = from[2 * i] - from[2 * i + 3];
            z[i + 1] = from[2 * i + 1] + from[2 * i + 2];
            mirrored[i] = from[2 * i] + from[2 * i + 3];
            mirrored[i + 1] = from[2 * i + 2] - from[2 * i + 1];
        }
    }
    if (n % 2 == 0) std::fill_n(both + (size_t)(n / 2) * slabWidth, slabWidth, T(0));
    work.plans[2].back(both, row);
    for (int k = n; k < work.layout.rowLength; k++)
        std::copy_n(row + (size_t)(k - n) * slabWidth, slabWidth, row + (size_t)k * slabWidth);
}

/** Transform a row of all components. */
template <typename T>
void rowsThere(const GridWork<T>& work, int y, const GridSlab<T>& slab, GridScratch<T>& scratch) {
    const GridLayout& layout = work.layout;
    const int n = layout.shape.size[2];
    for (int c = 0; c < 3; c++) {
        T* const row = slab.row(layout, c, y);
        for (int k = n; k < layout.rowLength; k++)
            for (int i = 0; i < slabWidth; i++)
                row[(size_t)(k % n) * slabWidth + i] += row[(size_t)k * slabWidth + i];
        const TimeOfLife timer(scratch.seconds.transforms);
        rowThere(work, row, scratch);
    }
}
template <typename T>
void rowsBack(const GridWork<T>& work, int y, const GridSlab<T>& slab, GridScratch<T>& scratch) {
    const TimeOfLife timer(scratch.seconds.transforms);
    for (int c = 0; c < 3; c++) rowBack(work, slab.row(work.layout, c, y), scratch);
}

// ---- Mirrored columns along y: sums of cosines, and sums of sines for the component across the
// walls, by transforms of as many numbers as there are rows

/**
 * The index of a row in a transform: even rows first, then odd rows from the end on. Odd rows are
 * negative where the component is odd about the walls.
 */
inline int placeInTransform(int y, int rows) { return y % 2 == 0 ? y / 2 : rows - 1 - y / 2; }
template <typename T>
void copyRow(const T* from, T* to, bool negative) {
    if (negative)
        for (int i = 0; i < modeWidth; i++) to[i] = -from[i];
    else
        std::memcpy(to, from, modeWidth * sizeof(T));
}

/**
 * Make from the transform V of such a column the modes that a transform of the whole period would
 * give: t V_m + s t* V_-m, t = exp(-i pi m/(2 rows)), with s = 1 for even components and -1 for odd
 * ones. Reference: Makhoul, IEEE Trans. Acoust. Speech Signal Process. 28, 27 (1980).
 */
template <typename T>
void mirroredThere(const GridWork<T>& work, T* column, T s) {
    const int rows = work.layout.numRows;
    for (int i = 0; i < modeWidth; i++) column[i] *= 1 + s;
    for (int m = 1; 2 * m <= rows; m++) {
        T *low = column + (size_t)m * modeWidth, *high = column + (size_t)(rows - m) * modeWidth;
        const T c = work.halfTurns[2 * m], d = work.halfTurns[2 * m + 1];
        for (int i = 0; i < modeWidth; i += 2) {
            // a = t V_m, b = s t* V_-m; mode m is a + b, mode rows - m is s i (a - b).
            const T aRe = c * low[i] + d * low[i + 1], aIm = c * low[i + 1] - d * low[i];
            const T bRe = s * (c * high[i] - d * high[i + 1]),
                    bIm = s * (c * high[i + 1] + d * high[i]);
            high[i] = s * (bIm - aIm);
            high[i + 1] = s * (aRe - bRe);
            low[i] = aRe + bRe;
            low[i + 1] = aIm + bIm;
        }
    }
}

/**
 * The way back: make from modes X the transform t* (X_m - i s X_(rows - m)), which gives the
 * period, without the mode of the Nyquist index.
 */
template <typename T>
void mirroredBack(const GridWork<T>& work, T* column, T s) {
    const int rows = work.layout.numRows;
    if (s < 0) std::fill_n(column, modeWidth, T(0));
    for (int m = 1; 2 * m <= rows; m++) {
        T *low = column + (size_t)m * modeWidth, *high = column + (size_t)(rows - m) * modeWidth;
        const T c = work.halfTurns[2 * m], d = work.halfTurns[2 * m + 1];
        for (int i = 0; i < modeWidth; i += 2) {
            // e = i s X_(rows - m); number m is t* (X_m - e), number rows - m is s t (X_m + e).
            const T eRe = -s * high[i + 1], eIm = s * high[i];
            const T pRe = low[i] - eRe, pIm = low[i + 1] - eIm, qRe = s * (low[i] + eRe),
                    qIm = s * (low[i + 1] + eIm);
            low[i] = c * pRe - d * pIm;
            low[i + 1] = c * pIm + d * pRe;
            high[i] = c * qRe + d * qIm;
            high[i + 1] = c * qIm - d * qRe;
        }
    }
}

/** Add the forces on outer rows, reflected, to the rows that the outer rows are reflections of. */
template <typename T>
void foldOuterRows(const GridLayout& layout, const GridSlab<T>& slab) {
    for (int c = 0; c < 3; c++)
        layout.forOuterRows([&](int row, int outer) {
            T* const to = slab.atPlace(layout, c, row);
            const T* const from = slab.atPlace(layout, c, outer);
            const T sign = c == 1 ? -1 : 1;
            for (size_t i = 0; i < layout.rowNumbers(); i++) to[i] += sign * from[i];
        });
}
/** Fill the outer rows with the flow. */
template <typename T>
void fillOuterRows(const GridLayout& layout, const GridSlab<T>& slab) {
    for (int c = 0; c < 3; c++)
        layout.forOuterRows([&](int row, int outer) {
            T* const to = slab.atPlace(layout, c, outer);
            const T* const from = slab.atPlace(layout, c, row);
            const T sign = c == 1 ? -1 : 1;
            for (size_t i = 0; i < layout.rowNumbers(); i++) to[i] = sign * from[i];
        });
}

// ---- Columns along y, a few at a time, from and to the modes of the grid. The transform along x
// is the next.

template <typename T>
void slabThere(const GridWork<T>& work, int slabNumber, const GridSlab<T>& slab,
               GridScratch<T>& scratch) {
    const TimeOfLife timer(scratch.seconds.transforms);
    const GridLayout& layout = work.layout;
    const int size = layout.numRows;
    const bool mirrored = layout.shape.mirrored;
    const size_t column = (size_t)size * modeWidth;
    T *const columns = scratch.columns.data(), *const transformed = scratch.transformed.data();
    const SlabLanes<T> d;
    for (int c = 0; c < 3; c++)
        for (int z = 0; z < layout.numModes; z += modesAtOnce) {
            const int count = std::min(modesAtOnce, layout.numModes - z);
            for (int y = 0; y < size; y++) {
                const T* from = slab.row(layout, c, y) + (size_t)z * modeWidth;
                const int at = mirrored ? placeInTransform(y, size) : y;
                for (int k = 0; k < count; k++)
                    copyRow(from + k * modeWidth, columns + k * column + (size_t)at * modeWidth,
                            mirrored && c == 1 && y % 2 == 1);
            }
            for (int k = 0; k < count; k++) {
                work.plans[1].there(columns + k * column, transformed + k * column);
                if (mirrored) mirroredThere(work, transformed + k * column, T(c == 1 ? -1 : 1));
            }
            for (int y = 0; y < size; y++)
                for (int k = 0; k < count; k++) {
                    const T* from = transformed + k * column + (size_t)y * modeWidth;
                    T* to =
                        work.modes[c] + layout.column(y, z + k) + (size_t)slabNumber * modeWidth;
                    if (work.streams)
                        for (int i = 0; i < modeWidth; i += hn::Lanes(d))
                            hn::Stream(hn::Load(d, from + i), d, to + i);
                    else
                        std::memcpy(to, from, modeWidth * sizeof(T));
                }
        }
    if (work.streams) hwy::FlushStream();  // other threads read the modes next
}

template <typename T>
void slabBack(const GridWork<T>& work, int slabNumber, const GridSlab<T>& slab,
              GridScratch<T>& scratch) {
    const TimeOfLife timer(scratch.seconds.transforms);
    const GridLayout& layout = work.layout;
    const int size = layout.numRows, ahead = 4, line = 64;
    const bool mirrored = layout.shape.mirrored;
    const size_t column = (size_t)size * modeWidth;
    T *const columns = scratch.columns.data(), *const transformed = scratch.transformed.data();
    for (int c = 0; c < 3; c++)
        for (int z = 0; z < layout.numModes; z += modesAtOnce) {
            const int count = std::min(modesAtOnce, layout.numModes - z);
            for (int y = 0; y < size; y++)
                for (int k = 0; k < count; k++) {
                    const T* from =
                        work.modes[c] + layout.column(y, z + k) + (size_t)slabNumber * modeWidth;
                    const char* later = reinterpret_cast<const char*>(
                        from + std::min(ahead, size - 1 - y) * layout.column(1, 0));
                    for (size_t at = 0; at < modeWidth * sizeof(T); at += line)
                        __builtin_prefetch(later + at);
                    std::memcpy(columns + k * column + (size_t)y * modeWidth, from,
                                modeWidth * sizeof(T));
                }
            for (int k = 0; k < count; k++) {
                if (mirrored) mirroredBack(work, columns + k * column, T(c == 1 ? -1 : 1));
                work.plans[1].back(columns + k * column, transformed + k * column);
            }
            for (int y = 0; y < size; y++) {
                T* to = slab.row(layout, c, y) + (size_t)z * modeWidth;
                const int at = mirrored ? placeInTransform(y, size) : y;
                for (int k = 0; k < count; k++)
                    copyRow(transformed + k * column + (size_t)at * modeWidth, to + k * modeWidth,
                            mirrored && c == 1 && y % 2 == 1);
            }
        }
}

// ---- A slab there and back

/** Transform forces to the modes along y and z of a slab. */
template <typename T>
void spreadSlab(const GridWork<T>& work, const GridStencils& stencils, int slabNumber,
                const double* forces, GridScratch<T>& scratch) {
    const GridLayout& layout = work.layout;
    const GridSlab<T> slab = {{scratch.slab.data(), scratch.slab.data() + layout.slabNumbers(),
                               scratch.slab.data() + 2 * layout.slabNumbers()}};
    {
        const double before = scratch.seconds.transforms;
        {
            const TimeOfLife timer(scratch.seconds.spreading);
            // Rows are emptied before the first particle that reaches them, and transformed after
            // the last one. Rows at the beginning are also reached across the end of the period. On
            // a mirrored grid, rows at the end are also reached across their wall.
            const int size = layout.numRows, firstRow = std::min(size, stencils.largestWidth(1)),
                      lastRow = std::max(firstRow, size - layout.reach);
            int empty = 0, row = firstRow;
            for (T* component : slab.values)
                std::fill(component + size * layout.rowNumbers(), component + layout.slabNumbers(),
                          T(0));
            const auto emptyUpTo = [&](int end) {
                if (end <= empty) return;
                for (T* component : slab.values)
                    std::fill(component + empty * layout.rowNumbers(),
                              component + end * layout.rowNumbers(), T(0));
                empty = end;
            };
            for (int s = stencils.beginOfSlab(slabNumber); s < stencils.beginOfSlab(slabNumber + 1);
                 s++) {
                const GridStencils::Slice& slice = stencils.slice(s);
                const GridStencils::Stencil& stencil = stencils[slice.particle];
                stencils.prefetchAfter(s);
                emptyUpTo(std::min(size, stencil.first[1] + stencil.width[1]));
                for (; row < std::min(lastRow, stencils.firstRowOfTile(slice)); row++)
                    rowsThere(work, row, slab, scratch);
                spreadSlice(stencils, slice,
                            forces + stencils.getParticles().firstRow[slice.particle], layout,
                            slab);
            }
            emptyUpTo(size);
            foldOuterRows(layout, slab);
            for (; row < size; row++) rowsThere(work, row, slab, scratch);
            for (row = 0; row < firstRow; row++) rowsThere(work, row, slab, scratch);
        }
        scratch.seconds.spreading -= scratch.seconds.transforms - before;
    }
    slabThere(work, slabNumber, slab, scratch);
}

/**
 * Compute averages over the slices of a slab of nodes. ready(rows) is called before rows up to this
 * one are needed.
 */
template <typename T, class Ready>
void averageSlices(const GridLayout& layout, const GridStencils& stencils, int slabNumber,
                   const GridSlab<T>& slab, bool gradients, double* parts, const Ready& ready) {
    const int size = layout.shape.size[1];
    for (int s = stencils.beginOfSlab(slabNumber); s < stencils.beginOfSlab(slabNumber + 1); s++) {
        const GridStencils::Slice& slice = stencils.slice(s);
        const GridStencils::Stencil& stencil = stencils[slice.particle];
        stencils.prefetchAfter(s);
        ready(std::min(size, stencil.first[1] + stencil.width[1]));
        double* part = parts + numbersOfPart * (size_t)s;
        if (gradients)
            averageGradientSlice(stencils, slice, layout, slab, part);
        else
            averageSlice(stencils, slice, layout, slab, part);
    }
}

/** Compute averages from the modes along y and z of a slab. */
template <typename T>
void averageSlab(const GridWork<T>& work, const GridStencils& stencils, int slabNumber,
                 double* parts, GridScratch<T>& scratch) {
    const GridLayout& layout = work.layout;
    const GridSlab<T> slab = {{scratch.slab.data(), scratch.slab.data() + layout.slabNumbers(),
                               scratch.slab.data() + 2 * layout.slabNumbers()}};
    slabBack(work, slabNumber, slab, scratch);
    const double before = scratch.seconds.transforms;
    {
        const TimeOfLife timer(scratch.seconds.averaging);
        int row = 0;
        bool hasOuter = false;
        averageSlices(layout, stencils, slabNumber, slab, false, parts, [&](int end) {
            for (; row < std::min(end, layout.numRows); row++) rowsBack(work, row, slab, scratch);
            if (end > layout.numRows && !hasOuter) {
                fillOuterRows(layout, slab);
                hasOuter = true;
            }
        });
    }
    scratch.seconds.averaging -= scratch.seconds.transforms - before;
}

/** Compute the whole slab of a field. */
template <typename T>
void fieldSlab(const GridWork<T>& work, int slabNumber, const GridSlab<T>& slab,
               GridScratch<T>& scratch) {
    slabBack(work, slabNumber, slab, scratch);
    for (int row = 0; row < work.layout.numRows; row++) rowsBack(work, row, slab, scratch);
    fillOuterRows(work.layout, slab);
}

// ---- Columns along x

/**
 * modes <- scale k^(-2 or -1) (1 - k k/k^2) modes of one column. Modes that are left out become 0.
 *
 * @param root  whether by the root of the fluid's response: k^-1
 */
template <typename T>
void projectColumn(const GridWork<T>& work, int y, int z, double scale, bool root,
                   T* const* modes) {
    const SlabLanes<T> d;
    const GridShape& shape = work.layout.shape;
    const auto one = hn::Set(d, T(1)), ky = hn::Set(d, static_cast<T>(shape.waveNumber(1, y))),
               kz = hn::Set(d, static_cast<T>(shape.waveNumber(2, z))),
               keep = hn::Set(d, static_cast<T>(shape.isNyquist(1, y) ? 0 : scale));
    const auto square = hn::MulAdd(kz, kz, hn::Mul(ky, ky));
    for (size_t i = 0; i < work.layout.columnNumbers(); i += hn::Lanes(d)) {
        const auto kx = hn::Load(d, work.kx + i);
        auto k2 = hn::MulAdd(kx, kx, square);
        k2 = hn::IfThenElse(hn::Gt(k2, hn::Zero(d)), k2, one);  // left out below
        const auto inverse = hn::Div(one, k2);
        const auto strength = hn::Mul(hn::Mul(hn::Load(d, work.keepsX + i), keep),
                                      root ? hn::Sqrt(inverse) : inverse);
        T *u = modes[0] + i, *v = modes[1] + i, *w = modes[2] + i;
        const auto fu = hn::Load(d, u), fv = hn::Load(d, v), fw = hn::Load(d, w);
        const auto along =
            hn::Mul(inverse, hn::MulAdd(kx, fu, hn::MulAdd(ky, fv, hn::Mul(kz, fw))));
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, kx, fu)), d, u);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, ky, fv)), d, v);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, kz, fw)), d, w);
    }
    if (y == 0 && z == 0)
        for (int c = 0; c < 3; c++) modes[c][0] = modes[c][1] = 0;
}

/** Three columns to work on, one for each component, with zeros as padding. */
template <typename T>
std::array<T*, 3> emptyColumns(const GridWork<T>& work, GridScratch<T>& scratch) {
    const size_t length = work.layout.columnNumbers();
    T* const first = scratch.columns.data();
    std::fill_n(first, 3 * length, T(0));
    return {first, first + length, first + 2 * length};
}

/** Transform back along x, with zeros in the planes that the last slab lacks. */
template <typename T>
void columnsBack(const GridWork<T>& work, int y, int z, T* const* modes) {
    for (int c = 0; c < 3; c++) {
        T* to = work.modes[c] + work.layout.column(y, z);
        work.plans[0].back(modes[c], to);
        std::fill(to + 2 * work.layout.shape.size[0], to + work.layout.columnNumbers(), T(0));
    }
}

/** There, through the fluid, and back, along x. */
template <typename T>
void solveColumns(const GridWork<T>& work, int y, double viscosity, GridScratch<T>& scratch) {
    const TimeOfLife timer(scratch.seconds.transforms);
    const GridLayout& layout = work.layout;
    const std::array<T*, 3> modes = emptyColumns(work, scratch);
    // Modes of rows are twice as large; transforms there and back multiply by the number of nodes.
    const double scale = 0.5 / (viscosity * layout.shape.numNodes());
    for (int z = 0; z < layout.numModes; z++) {
        for (int c = 0; c < 3; c++)
            work.plans[0].there(work.modes[c] + layout.column(y, z), modes[c]);
        projectColumn(work, y, z, scale, false, modes.data());
        columnsBack(work, y, z, modes.data());
    }
}

void drawRow(const GridWork<double>& work, int y, double viscosity, const ModeNoise& noise,
             const int* waveIndices, std::complex<double>* numbers, GridScratch<double>& scratch) {
    const GridShape& shape = work.layout.shape;
    const int size = shape.size[0];
    const std::array<double*, 3> modes = emptyColumns(work, scratch);
    const double scale = 1 / std::sqrt(viscosity * shape.numNodes());
    for (int z = 0; z < work.layout.numModes; z++) {
        if (!shape.isNyquist(1, y)) {
            noise.fill(waveIndices, size, shape.waveIndex(1, y), z, numbers);
            for (int c = 0; c < 3; c++)
                std::memcpy(modes[c], numbers + (size_t)c * size,
                            size * sizeof(std::complex<double>));
        }
        const TimeOfLife timer(scratch.seconds.transforms);
        projectColumn(work, y, z, scale, true, modes.data());
        columnsBack(work, y, z, modes.data());
    }
}

// ---- Columns along x of channels

/** to <- to + factors i k x from/2, for one column. */
template <typename T>
void addHalfCurl(const GridWork<T>& work, int y, int z, const T* factors, T* const* from,
                 T* const* to) {
    const T ky = static_cast<T>(work.layout.shape.waveNumber(1, y)),
            kz = static_cast<T>(work.layout.shape.waveNumber(2, z));
    const T *u = from[0], *v = from[1], *w = from[2];
    for (int re = 0; re < 2 * work.layout.shape.size[0]; re += 2) {
        const int im = re + 1;
        const T kx = work.kx[re], half = T(0.5) * factors[re];
        to[0][re] -= half * (ky * w[im] - kz * v[im]);
        to[0][im] += half * (ky * w[re] - kz * v[re]);
        to[1][re] -= half * (kz * u[im] - kx * w[im]);
        to[1][im] += half * (kz * u[re] - kx * w[re]);
        to[2][re] -= half * (kx * v[im] - ky * u[im]);
        to[2][im] += half * (kx * v[re] - ky * u[re]);
    }
}

/** modes <- scale (1 - k k/k^2) modes of one column. */
template <typename T>
void projectAcross(const GridWork<T>& work, int y, int z, double scale, T* const* modes) {
    const SlabLanes<T> d;
    const auto one = hn::Set(d, T(1)),
               ky = hn::Set(d, static_cast<T>(work.layout.shape.waveNumber(1, y))),
               kz = hn::Set(d, static_cast<T>(work.layout.shape.waveNumber(2, z))),
               strength = hn::Set(d, static_cast<T>(scale));
    const auto square = hn::MulAdd(kz, kz, hn::Mul(ky, ky));
    for (size_t i = 0; i < work.layout.columnNumbers(); i += hn::Lanes(d)) {
        const auto kx = hn::Load(d, work.kx + i);
        auto k2 = hn::MulAdd(kx, kx, square);
        k2 = hn::IfThenElse(hn::Gt(k2, hn::Zero(d)), k2, one);  // the factor of such a mode is 0
        T *u = modes[0] + i, *v = modes[1] + i, *w = modes[2] + i;
        const auto fu = hn::Load(d, u), fv = hn::Load(d, v), fw = hn::Load(d, w);
        const auto along = hn::Div(hn::MulAdd(kx, fu, hn::MulAdd(ky, fv, hn::Mul(kz, fw))), k2);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, kx, fu)), d, u);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, ky, fv)), d, v);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, kz, fw)), d, w);
    }
}

/**
 * to <- factors times the flow, or times half of its curl, and then back along x to the modes of a
 * channel.
 */
template <typename T>
void columnsToChannel(const GridWork<T>& work, const ChannelWork<T>& channel, int y, int z,
                      T* const* flow, T* const* to) {
    const size_t length = work.layout.columnNumbers();
    const T* const factors = channel.factors->column(y, z, T());
    const SlabLanes<T> d;
    if (channel.ofTorques) {
        for (int c = 0; c < 3; c++) std::fill_n(to[c], length, T(0));
        addHalfCurl(work, y, z, factors, flow, to);
    } else {
        for (size_t i = 0; i < length; i += hn::Lanes(d)) {
            const auto phi = hn::Load(d, factors + i);
            for (int c = 0; c < 3; c++)
                hn::Store(hn::Mul(phi, hn::Load(d, flow[c] + i)), d, to[c] + i);
        }
    }
    for (int c = 0; c < 3; c++) {
        T* const modes = channel.modes[c] + work.layout.column(y, z);
        work.plans[0].back(to[c], modes);
        std::fill(modes + 2 * work.layout.shape.size[0], modes + length, T(0));
    }
}

/**
 * Memory for three columns of a channel, and for three of the sum over channels, with zeros as
 * padding.
 */
template <typename T>
void emptyChannels(const GridWork<T>& work, GridScratch<T>& scratch, T** own, T** sum) {
    const size_t length = work.layout.columnNumbers();
    scratch.channels.resize(6 * length);
    std::fill_n(scratch.channels.data(), 6 * length, T(0));
    for (int c = 0; c < 3; c++) {
        own[c] = scratch.channels.data() + c * length;
        sum[c] = own[c] + 3 * length;
    }
}

/** There, through the fluid, and back, along x. */
template <typename T>
void solveChannels(const GridWork<T>& work, const ChannelWork<T>* channels, int count, int y,
                   double viscosity, GridScratch<T>& scratch) {
    const TimeOfLife timer(scratch.seconds.transforms);
    const GridLayout& layout = work.layout;
    const SlabLanes<T> d;
    T *own[3], *sum[3];
    emptyChannels(work, scratch, own, sum);
    // As in solveColumns().
    const double scale = 0.5 / (viscosity * layout.shape.numNodes());
    for (int z = 0; z < layout.numModes; z++) {
        for (int c = 0; c < 3; c++) std::fill_n(sum[c], layout.columnNumbers(), T(0));
        for (int g = 0; g < count; g++) {
            for (int c = 0; c < 3; c++)
                work.plans[0].there(channels[g].modes[c] + layout.column(y, z), own[c]);
            const T* const factors = channels[g].factors->column(y, z, T());
            if (channels[g].ofTorques) {
                addHalfCurl(work, y, z, factors, own, sum);
                continue;
            }
            for (size_t i = 0; i < layout.columnNumbers(); i += hn::Lanes(d)) {
                const auto phi = hn::Load(d, factors + i);
                for (int c = 0; c < 3; c++)
                    hn::Store(hn::MulAdd(phi, hn::Load(d, own[c] + i), hn::Load(d, sum[c] + i)), d,
                              sum[c] + i);
            }
        }
        projectAcross(work, y, z, scale, sum);
        for (int g = 0; g < count; g++) columnsToChannel(work, channels[g], y, z, sum, own);
    }
}

void drawChannelRow(const GridWork<double>& work, const ChannelWork<double>* channels, int count,
                    int y, double viscosity, const ModeNoise& noise, const int* waveIndices,
                    std::complex<double>* numbers, GridScratch<double>& scratch) {
    const GridShape& shape = work.layout.shape;
    const int size = shape.size[0];
    double *own[3], *sum[3];
    emptyChannels(work, scratch, own, sum);
    const double scale = 1 / std::sqrt(viscosity * shape.numNodes());
    for (int z = 0; z < work.layout.numModes; z++) {
        if (!shape.isNyquist(1, y)) {
            noise.fill(waveIndices, size, shape.waveIndex(1, y), z, numbers);
            for (int c = 0; c < 3; c++)
                std::memcpy(sum[c], numbers + (size_t)c * size,
                            size * sizeof(std::complex<double>));
        }
        const TimeOfLife timer(scratch.seconds.transforms);
        projectAcross(work, y, z, scale, sum);
        for (int g = 0; g < count; g++) columnsToChannel(work, channels[g], y, z, sum, own);
    }
}

/** CounterModeNoise::fill() with packs of modes. */
void fillModes(const NoiseStream& noise, uint32_t purpose, const int* nx, int count, int ny, int nz,
               std::complex<double>* numbers) {
    const int width = lanes(Pack(0.0));
    const double half = std::sqrt(0.5);
    for (int i = 0; i < count; i += width) {
        int index[BodySet::blockSize] = {0};
        double sign[BodySet::blockSize] = {0};
        const int valid = std::min(width, count - i);
        for (int k = 0; k < valid; k++) {
            const int s = CounterModeNoise::isMirrored(nx[i + k], ny, nz) ? -1 : 1;
            sign[k] = s * half;
            index[k] = static_cast<int>(NoiseStream::indexOfMode(s * nx[i + k], s * ny, nz));
        }
        Pack n[6];
        noisePairs<3>(noise, purpose, index, NoiseStream::blockOfMode(nz, 0), n);
        double re[BodySet::blockSize], im[BodySet::blockSize];
        for (int c = 0; c < 3; c++) {
            store(n[2 * c], re);
            store(n[2 * c + 1], im);
            for (int k = 0; k < valid; k++)
                numbers[c * count + i + k] = {half * re[k], sign[k] * im[k]};
        }
    }
}

// ---- Functions for the dispatch, which takes no templates

void spreadSlabExactly(const GridWork<double>& work, const GridStencils& stencils, int slab,
                       const double* forces, GridScratch<double>& scratch) {
    spreadSlab(work, stencils, slab, forces, scratch);
}
void spreadSlabRoughly(const GridWork<float>& work, const GridStencils& stencils, int slab,
                       const double* forces, GridScratch<float>& scratch) {
    spreadSlab(work, stencils, slab, forces, scratch);
}
void solveExactly(const GridWork<double>& work, int y, double viscosity,
                  GridScratch<double>& scratch) {
    solveColumns(work, y, viscosity, scratch);
}
void solveRoughly(const GridWork<float>& work, int y, double viscosity,
                  GridScratch<float>& scratch) {
    solveColumns(work, y, viscosity, scratch);
}
void solveChannelsExactly(const GridWork<double>& work, const ChannelWork<double>* channels,
                          int count, int y, double viscosity, GridScratch<double>& scratch) {
    solveChannels(work, channels, count, y, viscosity, scratch);
}
void solveChannelsRoughly(const GridWork<float>& work, const ChannelWork<float>* channels,
                          int count, int y, double viscosity, GridScratch<float>& scratch) {
    solveChannels(work, channels, count, y, viscosity, scratch);
}
void averageSlabExactly(const GridWork<double>& work, const GridStencils& stencils, int slab,
                        double* parts, GridScratch<double>& scratch) {
    averageSlab(work, stencils, slab, parts, scratch);
}
void averageSlabRoughly(const GridWork<float>& work, const GridStencils& stencils, int slab,
                        double* parts, GridScratch<float>& scratch) {
    averageSlab(work, stencils, slab, parts, scratch);
}
void fillFieldSlab(const GridWork<double>& work, int slabNumber, const GridSlab<double>& slab,
                   GridScratch<double>& scratch) {
    fieldSlab(work, slabNumber, slab, scratch);
}
void averageFieldSlab(const GridLayout& layout, const GridStencils& stencils, int slabNumber,
                      const GridSlab<double>& slab, bool gradients, double* parts) {
    averageSlices(layout, stencils, slabNumber, slab, gradients, parts, [](int) {});
}
}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(spreadSlabExactly);
HWY_EXPORT(spreadSlabRoughly);
HWY_EXPORT(solveExactly);
HWY_EXPORT(solveRoughly);
HWY_EXPORT(solveChannelsExactly);
HWY_EXPORT(solveChannelsRoughly);
HWY_EXPORT(drawChannelRow);
HWY_EXPORT(averageSlabExactly);
HWY_EXPORT(averageSlabRoughly);
HWY_EXPORT(drawRow);
HWY_EXPORT(fillFieldSlab);
HWY_EXPORT(averageFieldSlab);
HWY_EXPORT(fillModes);

namespace {

// One name for both precisions.
void spread(const GridWork<double>& work, const GridStencils& stencils, int slab,
            const double* forces, GridScratch<double>& scratch) {
    HWY_DYNAMIC_DISPATCH(spreadSlabExactly)(work, stencils, slab, forces, scratch);
}
void spread(const GridWork<float>& work, const GridStencils& stencils, int slab,
            const double* forces, GridScratch<float>& scratch) {
    HWY_DYNAMIC_DISPATCH(spreadSlabRoughly)(work, stencils, slab, forces, scratch);
}
void solve(const GridWork<double>& work, int y, double viscosity, GridScratch<double>& scratch) {
    HWY_DYNAMIC_DISPATCH(solveExactly)(work, y, viscosity, scratch);
}
void solve(const GridWork<float>& work, int y, double viscosity, GridScratch<float>& scratch) {
    HWY_DYNAMIC_DISPATCH(solveRoughly)(work, y, viscosity, scratch);
}
void solve(const GridWork<double>& work, const std::vector<ChannelWork<double> >& channels, int y,
           double viscosity, GridScratch<double>& scratch) {
    HWY_DYNAMIC_DISPATCH(solveChannelsExactly)
    (work, channels.data(), channels.size(), y, viscosity, scratch);
}
void solve(const GridWork<float>& work, const std::vector<ChannelWork<float> >& channels, int y,
           double viscosity, GridScratch<float>& scratch) {
    HWY_DYNAMIC_DISPATCH(solveChannelsRoughly)
    (work, channels.data(), channels.size(), y, viscosity, scratch);
}
void averageModes(const GridWork<double>& work, const GridStencils& stencils, int slab,
                  double* parts, GridScratch<double>& scratch) {
    HWY_DYNAMIC_DISPATCH(averageSlabExactly)(work, stencils, slab, parts, scratch);
}
void averageModes(const GridWork<float>& work, const GridStencils& stencils, int slab,
                  double* parts, GridScratch<float>& scratch) {
    HWY_DYNAMIC_DISPATCH(averageSlabRoughly)(work, stencils, slab, parts, scratch);
}

}  // namespace

/** Plans and memory for grids of one size, in one precision. */
template <typename T>
class GridEngine {
public:
    GridEngine(const GridThreads& threads, GridSeconds& seconds)
        : threads(threads), seconds(seconds) {}
    void prepare(const GridStencils& stencils);
    const GridLayout& getLayout() const { return layout; }
    double bytes() const { return 3.0 * sizeof(T) * layout.modeNumbers(); }
    void multiply(const GridStencils& stencils, double viscosity, const double* forces,
                  double* velocities);
    void draw(double viscosity, const ModeNoise& noise, GridField& field);
    void average(const GridField& field, const GridStencils& stencils, bool gradients,
                 double* results);
    void multiply(const std::vector<GridChannel>& channels, double viscosity, const double* forces,
                  double* velocities);
    void draw(const std::vector<GridChannel>& channels, double viscosity, const ModeNoise& noise,
              std::vector<GridField>& fields);

private:
    typedef GridScratch<T> Scratch;
    GridWork<T> work() { return workOf(modes); }
    GridWork<T> workOf(AlignedArrayOf<T>* of) {
        // A grid with more bytes does not stay in caches from one pass to the next.
        const double cached = 16e6;
        return {layout,
                plans,
                {of[0].data(), of[1].data(), of[2].data()},
                waveNumbers.data(),
                keeps.data(),
                halfTurns.data(),
                bytes() > cached};
    }
    /** Call task(i, scratch) for i = 0 ... count - 1. Each range of them has its own scratch. */
    template <class Task>
    void forEach(int count, const Task& task);
    void sumParts(const GridStencils& stencils, bool gradients, double* results);

    const GridThreads& threads;
    GridSeconds& seconds;
    GridLayout layout;
    GridPlans<T> plans[3];
    /** Make the GridWork of each channel. The first channel uses the modes that exist already. */
    std::vector<GridWork<T> > worksOf(const std::vector<GridChannel>& channels,
                                      std::vector<ChannelWork<T> >& own);
    AlignedArrayOf<T> modes[3];
    std::vector<AlignedArrayOf<T> > modesOfOthers;    // of channels after the first, three each
    AlignedArrayOf<T> waveNumbers, keeps, halfTurns;  // GridWork
    std::vector<int> waveIndices;
    std::mutex scratchMutex;
    std::vector<std::unique_ptr<Scratch> > free;
    std::vector<double> parts;  // of averages, a slice after the other
};

template <typename T>
void GridEngine<T>::prepare(const GridStencils& stencils) {
    const GridLayout wanted(stencils);
    const std::array<int, 3>& n = wanted.shape.size;
    const bool same = layout.shape.size == n && layout.rowLength == wanted.rowLength &&
                      layout.numRows == wanted.numRows && layout.reach == wanted.reach;
    layout = wanted;
    const size_t column = layout.columnNumbers();
    waveNumbers.resize(column);
    keeps.resize(column);
    std::fill_n(waveNumbers.data(), column, T(0));
    std::fill_n(keeps.data(), column, T(0));
    waveIndices.resize(n[0]);
    for (int x = 0; x < n[0]; x++) {
        for (int part = 0; part < 2; part++) {
            waveNumbers[2 * x + part] = static_cast<T>(layout.shape.waveNumber(0, x));
            keeps[2 * x + part] = static_cast<T>(!layout.shape.isNyquist(0, x));
        }
        waveIndices[x] = layout.shape.waveIndex(0, x);
    }
    if (same) return;
    free.clear();
    for (AlignedArrayOf<T>& component : modes) component.resize(layout.modeNumbers());
    // One column along x; all planes of a slab along y, pairs of them along z.
    const int atOnce[3] = {1, slabWidth, slabWidth / 2}, lengths[3] = {n[0], layout.numRows, n[2]};
    for (int axis = 0; axis < 3; axis++) {
        plans[axis].there = FourierPlan<T>(lengths[axis], atOnce[axis], false);
        plans[axis].back = FourierPlan<T>(lengths[axis], atOnce[axis], true);
    }
    halfTurns.resize(2 * layout.numRows);
    for (int m = 0; m < layout.numRows; m++) {
        halfTurns[2 * m] = static_cast<T>(std::cos(M_PI * m / (2 * layout.numRows)));
        halfTurns[2 * m + 1] = static_cast<T>(std::sin(M_PI * m / (2 * layout.numRows)));
    }
}

template <typename T>
template <class Task>
void GridEngine<T>::forEach(int count, const Task& task) {
    const std::function<void(int, int)> range = [&](int first, int end) {
        std::unique_ptr<Scratch> scratch;
        {
            const std::lock_guard<std::mutex> lock(scratchMutex);
            if (!free.empty()) {
                scratch = std::move(free.back());
                free.pop_back();
            }
        }
        if (!scratch) {
            scratch.reset(new Scratch);
            const size_t alongY = (size_t)modesAtOnce * modeWidth * layout.numRows,
                         alongZ = (size_t)slabWidth * layout.shape.size[2];
            scratch->slab.resize(3 * layout.slabNumbers());
            scratch->columns.resize(std::max({3 * layout.columnNumbers(), alongY, alongZ}));
            scratch->transformed.resize(alongY);
        }
        for (int i = first; i < end; i++) task(i, *scratch);
        const std::lock_guard<std::mutex> lock(scratchMutex);
        seconds.add(scratch->seconds);
        scratch->seconds = {};
        free.push_back(std::move(scratch));
    };
    if (threads)
        threads(count, range);
    else
        range(0, count);
}

template <typename T>
void GridEngine<T>::multiply(const GridStencils& stencils, double viscosity, const double* forces,
                             double* velocities) {
    prepare(stencils);
    const GridWork<T> all = work();
    parts.resize(numbersOfPart * (size_t)stencils.numSlices());
    forEach(layout.numSlabs,
            [&](int slab, Scratch& scratch) { spread(all, stencils, slab, forces, scratch); });
    forEach(layout.numRows, [&](int y, Scratch& scratch) { solve(all, y, viscosity, scratch); });
    forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
        averageModes(all, stencils, slab, parts.data(), scratch);
    });
    sumParts(stencils, false, velocities);
}

template <typename T>
std::vector<GridWork<T> > GridEngine<T>::worksOf(const std::vector<GridChannel>& channels,
                                                 std::vector<ChannelWork<T> >& own) {
    prepare(*channels[0].stencils);
    modesOfOthers.resize(3 * (channels.size() - 1));
    for (AlignedArrayOf<T>& component : modesOfOthers) component.resize(layout.modeNumbers());
    std::vector<GridWork<T> > works;
    for (size_t g = 0; g < channels.size(); g++) {
        works.push_back(workOf(g == 0 ? modes : &modesOfOthers[3 * (g - 1)]));
        T* const* const at = works.back().modes;
        own.push_back({{at[0], at[1], at[2]}, channels[g].factors, channels[g].ofTorques});
    }
    return works;
}

template <typename T>
void GridEngine<T>::multiply(const std::vector<GridChannel>& channels, double viscosity,
                             const double* forces, double* velocities) {
    std::vector<ChannelWork<T> > own;
    const std::vector<GridWork<T> > works = worksOf(channels, own);
    for (size_t g = 0; g < channels.size(); g++) {
        const GridStencils& stencils = *channels[g].stencils;
        forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
            spread(works[g], stencils, slab, forces, scratch);
        });
        forces += stencils.getParticles().numRows;
    }
    forEach(layout.numRows,
            [&](int y, Scratch& scratch) { solve(works[0], own, y, viscosity, scratch); });
    for (size_t g = 0; g < channels.size(); g++) {
        const GridStencils& stencils = *channels[g].stencils;
        parts.resize(numbersOfPart * (size_t)stencils.numSlices());
        forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
            averageModes(works[g], stencils, slab, parts.data(), scratch);
        });
        sumParts(stencils, false, velocities);
        velocities += stencils.getParticles().numRows;
    }
}

/** A particle's slices are summed in their order, whichever thread averaged over them. */
template <typename T>
void GridEngine<T>::sumParts(const GridStencils& stencils, bool gradients, double* results) {
    const HydrodynamicParticles& particles = stencils.getParticles();
    forEach(particles.size(), [&](int p, Scratch&) {
        const int numbers = gradients ? 9 : particles.hasTorque[p] ? 6 : 3;
        double* sum = results + (gradients ? 9 * (size_t)p : particles.firstRow[p]);
        std::fill(sum, sum + numbers, 0.0);
        const GridStencils::Range own = stencils.slicesOf(p);
        for (int i = own.begin; i < own.end; i++) {
            const double* part = &parts[numbersOfPart * (size_t)stencils.sliceNumber(i)];
            for (int c = 0; c < numbers; c++) sum[c] += part[c];
        }
    });
}

namespace {

GridSlab<double> slabOf(const GridLayout& layout, const GridField& field, int slab) {
    GridSlab<double> nodes;
    // Averaging only reads.
    for (int c = 0; c < 3; c++)
        nodes.values[c] = const_cast<double*>(field.values[c].data()) + slab * layout.slabNumbers();
    return nodes;
}

}  // namespace

template <>
void GridEngine<double>::draw(double viscosity, const ModeNoise& noise, GridField& field) {
    field.shape = layout.shape;
    field.rowLength = layout.rowLength;
    for (AlignedArray& component : field.values)
        component.resize(layout.numSlabs * layout.slabNumbers());
    const GridWork<double> all = work();
    forEach(layout.numRows, [&](int y, Scratch& scratch) {
        scratch.noise.resize(2 * 3 * (size_t)layout.shape.size[0]);
        HWY_DYNAMIC_DISPATCH(drawRow)
        (all, y, viscosity, noise, waveIndices.data(),
         reinterpret_cast<std::complex<double>*>(scratch.noise.data()), scratch);
    });
    forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
        HWY_DYNAMIC_DISPATCH(fillFieldSlab)(all, slab, slabOf(layout, field, slab), scratch);
    });
}

template <>
void GridEngine<double>::draw(const std::vector<GridChannel>& channels, double viscosity,
                              const ModeNoise& noise, std::vector<GridField>& fields) {
    std::vector<ChannelWork<double> > own;
    const std::vector<GridWork<double> > works = worksOf(channels, own);
    forEach(layout.numRows, [&](int y, Scratch& scratch) {
        scratch.noise.resize(2 * 3 * (size_t)layout.shape.size[0]);
        HWY_DYNAMIC_DISPATCH(drawChannelRow)
        (works[0], own.data(), own.size(), y, viscosity, noise, waveIndices.data(),
         reinterpret_cast<std::complex<double>*>(scratch.noise.data()), scratch);
    });
    for (size_t g = 0; g < channels.size(); g++) {
        GridField& field = fields[g];
        field.shape = layout.shape;
        field.rowLength = layout.rowLength;
        for (AlignedArray& component : field.values)
            component.resize(layout.numSlabs * layout.slabNumbers());
        forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
            HWY_DYNAMIC_DISPATCH(fillFieldSlab)
            (works[g], slab, slabOf(layout, field, slab), scratch);
        });
    }
}

template <>
void GridEngine<double>::average(const GridField& field, const GridStencils& stencils,
                                 bool gradients, double* results) {
    parts.resize(numbersOfPart * (size_t)stencils.numSlices());
    forEach(layout.numSlabs, [&](int slab, Scratch& scratch) {
        const TimeOfLife timer(scratch.seconds.averaging);
        HWY_DYNAMIC_DISPATCH(averageFieldSlab)
        (layout, stencils, slab, slabOf(layout, field, slab), gradients, parts.data());
    });
    sumParts(stencils, gradients, results);
}

void SimdModeNoise::fill(const int* nx, int count, int ny, int nz,
                         std::complex<double>* numbers) const {
    HWY_DYNAMIC_DISPATCH(fillModes)(noise, purpose, nx, count, ny, nz, numbers);
}

CpuGridFluid::CpuGridFluid(GridThreads threads) : threads(std::move(threads)) {}

CpuGridFluid::~CpuGridFluid() {}

std::unique_ptr<ModeNoise> CpuGridFluid::modeNoise(const NoiseStream& noise,
                                                   uint32_t purpose) const {
    return std::unique_ptr<ModeNoise>(new SimdModeNoise(noise, purpose));
}

template <typename T>
GridEngine<T>& CpuGridFluid::prepare(std::unique_ptr<GridEngine<T> >& engine,
                                     const GridStencils& stencils) {
    if (!engine) engine.reset(new GridEngine<T>(threads, seconds));
    engine->prepare(stencils);
    held = memory(stencils.getShape());
    return *engine;
}

void CpuGridFluid::multiplyColumn(const GridStencils& stencils, double viscosity,
                                  const double* forces, double* velocities) {
    prepare(exact, stencils).multiply(stencils, viscosity, forces, velocities);
}

void CpuGridFluid::multiplyColumnRoughly(const GridStencils& stencils, double viscosity,
                                         const double* forces, double* velocities) {
    prepare(rough, stencils).multiply(stencils, viscosity, forces, velocities);
}

void CpuGridFluid::multiplyChannels(const std::vector<GridChannel>& channels, double viscosity,
                                    bool roughly, const double* forces, double* velocities) {
    if (roughly)
        prepare(rough, *channels[0].stencils).multiply(channels, viscosity, forces, velocities);
    else
        prepare(exact, *channels[0].stencils).multiply(channels, viscosity, forces, velocities);
    held = channels.size() * memory(channels[0].stencils->getShape());
}

void CpuGridFluid::drawChannels(const std::vector<GridChannel>& channels, double viscosity,
                                const ModeNoise& noise, std::vector<GridField>& fields) {
    prepare(exact, *channels[0].stencils).draw(channels, viscosity, noise, fields);
}

void CpuGridFluid::forRanges(int count, const std::function<void(int, int)>& task) const {
    if (threads)
        threads(count, task);
    else
        task(0, count);
}

void CpuGridFluid::drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
                             GridField& field) {
    prepare(exact, stencils).draw(viscosity, noise, field);
}

void CpuGridFluid::averageColumn(const GridField& field, const GridStencils& stencils,
                                 double* velocities) {
    prepare(exact, stencils).average(field, stencils, false, velocities);
}

void CpuGridFluid::averageGradientColumn(const GridField& field, const GridStencils& stencils,
                                         double* gradients) {
    prepare(exact, stencils).average(field, stencils, true, gradients);
}

}  // namespace RigidHIPlugin

#endif
