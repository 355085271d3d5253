// The steps of products and fields on a grid: transforms, the fluid's response, and the order in
// which the rows of a slab pass through these steps.

#if defined(RIGIDHI_GRID_KERNELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_GRID_KERNELS_INL_H_
#undef RIGIDHI_GRID_KERNELS_INL_H_
#else
#define RIGIDHI_GRID_KERNELS_INL_H_
#endif

#include <algorithm>
#include <complex>
#include <cstring>

#include "hwy/cache_control.h"
#include "hwy/highway.h"
#include "mobility/models/forcecoupling/GridKernels.h"
#include "mobility/models/forcecoupling/GridSlices-inl.h"
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

// ---- Rows along z: two neighbouring planes are the real and imaginary parts of one complex row

/**
 * Transform the nodes of a row to its modes. These are twice as large as the modes of the field.
 */
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

/**
 * Transform the modes of a row to its nodes, with copies beyond the end of the row for stencils.
 */
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
        const ScopedTimer timer(scratch.seconds.transforms);
        rowThere(work, row, scratch);
    }
}
template <typename T>
void rowsBack(const GridWork<T>& work, int y, const GridSlab<T>& slab, GridScratch<T>& scratch) {
    const ScopedTimer timer(scratch.seconds.transforms);
    for (int c = 0; c < 3; c++) rowBack(work, slab.row(work.layout, c, y), scratch);
}

// ---- Mirrored columns along y: sums of cosines, and sums of sines for the component normal to the
// walls. Each is a transform with as many numbers as rows.

/**
 * The index of a row in a transform: even rows first, then odd rows in reverse order. Odd rows
 * change sign if the component is odd about the walls.
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
 * From the transform V of such a column make the modes that a transform of the whole period would
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
 * The way back: from modes X make the transform t* (X_m - i s X_(rows - m)) of the period, without
 * the mode of the Nyquist index.
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

/**
 * Add the forces on outer rows, reflected, to the inner rows whose reflections the outer rows are.
 */
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
// comes next.

template <typename T>
void transformSlab(const GridWork<T>& work, T* const* modes, int slabNumber,
                   const GridSlab<T>& slab, GridScratch<T>& scratch) {
    const ScopedTimer timer(scratch.seconds.transforms);
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
                    T* to = modes[c] + layout.column(y, z + k) + (size_t)slabNumber * modeWidth;
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
void transformSlabBack(const GridWork<T>& work, T* const* modes, int slabNumber,
                       const GridSlab<T>& slab, GridScratch<T>& scratch) {
    const ScopedTimer timer(scratch.seconds.transforms);
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
                        modes[c] + layout.column(y, z + k) + (size_t)slabNumber * modeWidth;
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

// ---- The rows of a slab, from particles to modes along z and back

/**
 * Spread forces to the nodes of a slab, and transform rows to modes along z. A row is emptied just
 * before the first particle that reaches it, and transformed just after the last one, while it is
 * in the cache.
 */
template <typename T>
void spreadToSlab(const GridWork<T>& work, const GridStencils& stencils, int slabNumber,
                  bool dipoles, const double* forces, const GridSlab<T>& slab,
                  GridScratch<T>& scratch) {
    const TimeBesideTransforms timer(scratch.seconds, scratch.seconds.spreading);
    const GridLayout& layout = work.layout;
    // Particles also reach rows at the beginning across the end of the period. On a mirrored grid,
    // they also reach rows at the end across their wall.
    const int size = layout.numRows, firstRow = std::min(size, stencils.largestWidth(1)),
              lastRow = std::max(firstRow, size - layout.reach);
    const auto emptyRows = [&](int first, int end) {
        for (T* component : slab.values)
            std::fill(component + first * layout.rowNumbers(),
                      component + end * layout.rowNumbers(), T(0));
    };
    int empty = 0, row = firstRow;
    const auto emptyUpTo = [&](int end) {
        if (end <= empty) return;
        emptyRows(empty, end);
        empty = end;
    };
    emptyRows(size, layout.storedRows());
    for (int s = stencils.beginOfSlab(slabNumber); s < stencils.beginOfSlab(slabNumber + 1); s++) {
        const GridStencils::Slice& slice = stencils.slice(s);
        const GridStencils::Stencil& stencil = stencils[slice.particle];
        stencils.prefetchAfter(s);
        emptyUpTo(std::min(size, stencil.first[1] + stencil.width[1]));
        for (; row < std::min(lastRow, stencils.firstRowOfTile(slice)); row++)
            rowsThere(work, row, slab, scratch);
        if (dipoles)
            spreadDipoleSlice(stencils, slice, forces + 9 * (size_t)slice.particle, layout, slab);
        else
            spreadSlice(stencils, slice, forces + stencils.getParticles().firstRow[slice.particle],
                        layout, slab);
    }
    emptyUpTo(size);
    foldOuterRows(layout, slab);
    for (; row < size; row++) rowsThere(work, row, slab, scratch);
    for (row = 0; row < firstRow; row++) rowsThere(work, row, slab, scratch);
}

/**
 * Compute averages over the slices of a slab of nodes. Call ready(rows) before using rows up to
 * this one.
 */
template <typename T, class Ready>
void averageSlices(const GridLayout& layout, const GridStencils& stencils, int slabNumber,
                   const GridSlab<T>& slab, bool gradients, double* averages, const Ready& ready) {
    const int size = layout.shape.size[1];
    for (int s = stencils.beginOfSlab(slabNumber); s < stencils.beginOfSlab(slabNumber + 1); s++) {
        const GridStencils::Slice& slice = stencils.slice(s);
        const GridStencils::Stencil& stencil = stencils[slice.particle];
        stencils.prefetchAfter(s);
        ready(std::min(size, stencil.first[1] + stencil.width[1]));
        double* part = averages + numbersOfPart * (size_t)s;
        if (gradients)
            averageGradientSlice(stencils, slice, layout, slab, part);
        else
            averageSlice(stencils, slice, layout, slab, part);
    }
}

/**
 * Compute averages from the modes along z of a slab. A row is transformed back just before the
 * first particle that needs it.
 */
template <typename T>
void averageSlab(const GridWork<T>& work, const GridStencils& stencils, int slabNumber,
                 bool gradients, const GridSlab<T>& slab, double* averages,
                 GridScratch<T>& scratch) {
    const TimeBesideTransforms timer(scratch.seconds, scratch.seconds.averaging);
    const GridLayout& layout = work.layout;
    int row = 0;
    bool hasOuter = false;
    averageSlices(layout, stencils, slabNumber, slab, gradients, averages, [&](int end) {
        for (; row < std::min(end, layout.numRows); row++) rowsBack(work, row, slab, scratch);
        if (end > layout.numRows && !hasOuter) {
            fillOuterRows(layout, slab);
            hasOuter = true;
        }
    });
}

/** Compute all nodes of a slab from its modes along z. */
template <typename T>
void fillSlab(const GridWork<T>& work, const GridSlab<T>& slab, GridScratch<T>& scratch) {
    for (int row = 0; row < work.layout.numRows; row++) rowsBack(work, row, slab, scratch);
    fillOuterRows(work.layout, slab);
}

/** Compute averages, or gradients, over a slab with all nodes. */
template <typename T>
void averageFilledSlab(const GridWork<T>& work, const GridStencils& stencils, int slabNumber,
                       const GridSlab<T>& slab, bool gradients, double* averages,
                       GridScratch<T>& scratch) {
    const ScopedTimer timer(scratch.seconds.averaging);
    averageSlices(work.layout, stencils, slabNumber, slab, gradients, averages, [](int) {});
}

// ---- Columns along x, through the fluid. OwnEnvelopes (without channels) and SharedEnvelopes
// (with channels) contain the differences.

/** Transform back along x, with zeros in the missing planes of the last slab. */
template <typename T>
void columnsBack(const GridWork<T>& work, int y, int z, T* const* from, T* const* modes) {
    for (int c = 0; c < 3; c++) {
        T* const to = modes[c] + work.layout.column(y, z);
        work.plans[0].back(from[c], to);
        std::fill(to + 2 * work.layout.shape.size[0], to + work.layout.columnNumbers(), T(0));
    }
}

/** Columns of the three components, one after the other, with zeros in the padding. */
template <typename T>
std::array<T*, 3> emptyColumns(const GridWork<T>& work, T* first) {
    const size_t length = work.layout.columnNumbers();
    std::fill_n(first, 3 * length, T(0));
    return {first, first + length, first + 2 * length};
}

/** The wave vectors (kx, ky + kyOfKx kx, kz + kzOfKx kx) of a column. */
template <typename T>
struct ColumnOfModes {
    const T ky, kz, kyOfKx, kzOfKx;
    ColumnOfModes(const GridShape& shape, int y, int z)
        : ky(static_cast<T>(shape.waveNumber(1, y))),
          kz(static_cast<T>(shape.waveNumber(2, z) + shape.skew.yz * shape.waveNumber(1, y))),
          kyOfKx(static_cast<T>(shape.skew.xy)), kzOfKx(static_cast<T>(shape.skew.xz)) {}
};

/** to <- to + factors i k x from/2, for one column. */
template <typename T>
void addHalfCurl(const GridWork<T>& work, int y, int z, const T* factors, T* const* from,
                 T* const* to) {
    const ColumnOfModes<T> column(work.layout.shape, y, z);
    const T *u = from[0], *v = from[1], *w = from[2];
    for (int re = 0; re < 2 * work.layout.shape.size[0]; re += 2) {
        const int im = re + 1;
        const T kx = work.kx[re], ky = column.ky + column.kyOfKx * kx,
                kz = column.kz + column.kzOfKx * kx, half = T(0.5) * factors[re];
        to[0][re] -= half * (ky * w[im] - kz * v[im]);
        to[0][im] += half * (ky * w[re] - kz * v[re]);
        to[1][re] -= half * (kz * u[im] - kx * w[im]);
        to[1][im] += half * (kz * u[re] - kx * w[re]);
        to[2][re] -= half * (kx * v[im] - ky * u[im]);
        to[2][im] += half * (kx * v[re] - ky * u[re]);
    }
}

/**
 * Particles with their own envelopes, whose forces share one set of modes. The response of the
 * fluid is k^-2, and to random numbers its root k^-1.
 */
template <typename T>
struct OwnEnvelopes {
    const GridWork<T>& work;
    const ChannelWork<T>& channel;
    const std::array<T*, 3> flow;

    OwnEnvelopes(const GridWork<T>& work, const ChannelWork<T>* channels, int,
                 GridScratch<T>& scratch)
        : work(work), channel(channels[0]), flow(emptyColumns(work, scratch.columns.data())) {}
    /** Likewise with columns in the caller's memory. The constructor sets only their padding. */
    OwnEnvelopes(const GridWork<T>& work, const ChannelWork<T>& channel, T* first)
        : work(work), channel(channel), flow{first, first + work.layout.columnNumbers(),
                                             first + 2 * work.layout.columnNumbers()} {
        const size_t used = 2 * (size_t)work.layout.shape.size[0];
        for (T* component : flow)
            std::fill(component + used, component + work.layout.columnNumbers(), T(0));
    }
    /** Set the flow to the forces of a column of modes, transformed along x. */
    void gather(int y, int z) const {
        for (int c = 0; c < 3; c++)
            work.plans[0].there(channel.modes[c] + work.layout.column(y, z), flow[c]);
    }
    /** Transform the flow back along x. */
    void scatter(int y, int z) const { columnsBack(work, y, z, flow.data(), channel.modes); }

    /**
     * Set the strength of modes, and change `along` from k.f to the factor of k that project()
     * subtracts.
     */
    template <bool root, class V>
    static HWY_INLINE void respond(const T* keepsX, V scale, V k2, V& strength, V& along) {
        const SlabLanes<T> d;
        const auto inverse = hn::Div(hn::Set(d, T(1)), k2);
        strength = hn::Mul(hn::Mul(hn::Load(d, keepsX), scale), root ? hn::Sqrt(inverse) : inverse);
        along = hn::Mul(inverse, along);
    }
};

/**
 * Channels, each with its own modes. The factors of channels contain the whole response except the
 * projection.
 */
template <typename T>
struct SharedEnvelopes {
    const GridWork<T>& work;
    const ChannelWork<T>* channels;
    const int count;
    std::array<T*, 3> own, flow;  // of one channel, of all channels

    SharedEnvelopes(const GridWork<T>& work, const ChannelWork<T>* channels, int count,
                    GridScratch<T>& scratch)
        : work(work), channels(channels), count(count) {
        const size_t length = work.layout.columnNumbers();
        scratch.channels.resize(6 * length);
        own = emptyColumns(work, scratch.channels.data());
        flow = emptyColumns(work, scratch.channels.data() + 3 * length);
    }
    /** Likewise with the flow in the caller's memory, which gather() sets. */
    SharedEnvelopes(const GridWork<T>& work, const ChannelWork<T>* channels, int count,
                    GridScratch<T>& scratch, T* first)
        : work(work), channels(channels), count(count) {
        const size_t length = work.layout.columnNumbers();
        scratch.channels.resize(3 * length);
        own = emptyColumns(work, scratch.channels.data());
        flow = {first, first + length, first + 2 * length};
    }
    void gather(int y, int z) const {
        gather(y, z, [](int, T* const*) {});
    }
    /** Likewise, calling take(g, columns) with the forces of each channel. */
    template <class Take>
    void gather(int y, int z, const Take& take) const {
        const SlabLanes<T> d;
        const GridLayout& layout = work.layout;
        for (int c = 0; c < 3; c++) std::fill_n(flow[c], layout.columnNumbers(), T(0));
        for (int g = 0; g < count; g++) {
            for (int c = 0; c < 3; c++)
                work.plans[0].there(channels[g].modes[c] + layout.column(y, z), own[c]);
            take(g, own.data());
            const T* const factors = channels[g].factors->column(y, z, T());
            if (channels[g].ofTorques) {
                addHalfCurl(work, y, z, factors, own.data(), flow.data());
                continue;
            }
            for (size_t i = 0; i < layout.columnNumbers(); i += hn::Lanes(d)) {
                const auto phi = hn::Load(d, factors + i);
                for (int c = 0; c < 3; c++)
                    hn::Store(hn::MulAdd(phi, hn::Load(d, own[c] + i), hn::Load(d, flow[c] + i)), d,
                              flow[c] + i);
            }
        }
    }
    void scatter(int y, int z) const {
        scatter(y, z, [](int, T* const*) {});
    }
    /** Likewise, calling give(g, columns) to add to the flow of each channel. */
    template <class Give>
    void scatter(int y, int z, const Give& give) const {
        const SlabLanes<T> d;
        const size_t length = work.layout.columnNumbers();
        for (int g = 0; g < count; g++) {
            const T* const factors = channels[g].factors->column(y, z, T());
            if (channels[g].ofTorques) {
                for (int c = 0; c < 3; c++) std::fill_n(own[c], length, T(0));
                addHalfCurl(work, y, z, factors, flow.data(), own.data());
            } else {
                for (size_t i = 0; i < length; i += hn::Lanes(d)) {
                    const auto phi = hn::Load(d, factors + i);
                    for (int c = 0; c < 3; c++)
                        hn::Store(hn::Mul(phi, hn::Load(d, flow[c] + i)), d, own[c] + i);
                }
            }
            give(g, own.data());
            columnsBack(work, y, z, own.data(), channels[g].modes);
        }
    }
    template <bool root, class V>
    static HWY_INLINE void respond(const T*, V scale, V k2, V& strength, V& along) {
        strength = scale;
        along = hn::Div(along, k2);
    }
};

/**
 * flow <- scale r (1 - k k/k^2) flow, for one column, with the response r of the fluid or its root.
 * Excluded modes become 0.
 */
template <bool root, template <typename> class Envelopes, typename T>
void project(const Envelopes<T>& columns, int y, int z, double scale) {
    const SlabLanes<T> d;
    const GridWork<T>& work = columns.work;
    const GridShape& shape = work.layout.shape;
    const ColumnOfModes<T> column(shape, y, z);
    const auto one = hn::Set(d, T(1)), firstKy = hn::Set(d, column.ky),
               firstKz = hn::Set(d, column.kz), kyOfKx = hn::Set(d, column.kyOfKx),
               kzOfKx = hn::Set(d, column.kzOfKx),
               keep = hn::Set(d, static_cast<T>(shape.isNyquist(1, y) ? 0 : scale));
    for (size_t i = 0; i < work.layout.columnNumbers(); i += hn::Lanes(d)) {
        const auto kx = hn::Load(d, work.kx + i), ky = hn::MulAdd(kyOfKx, kx, firstKy),
                   kz = hn::MulAdd(kzOfKx, kx, firstKz);
        auto k2 = hn::MulAdd(kx, kx, hn::MulAdd(kz, kz, hn::Mul(ky, ky)));
        k2 = hn::IfThenElse(hn::Gt(k2, hn::Zero(d)), k2, one);  // excluded below
        T *u = columns.flow[0] + i, *v = columns.flow[1] + i, *w = columns.flow[2] + i;
        const auto fu = hn::Load(d, u), fv = hn::Load(d, v), fw = hn::Load(d, w);
        auto along = hn::MulAdd(kx, fu, hn::MulAdd(ky, fv, hn::Mul(kz, fw))), strength = keep;
        columns.template respond<root>(work.keepsX + i, keep, k2, strength, along);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, kx, fu)), d, u);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, ky, fv)), d, v);
        hn::Store(hn::Mul(strength, hn::NegMulAdd(along, kz, fw)), d, w);
    }
    if (y == 0 && z == 0)
        for (T* component : columns.flow) component[0] = component[1] = 0;
}

/** Call task(columns) with OwnEnvelopes or, for channels with factors, SharedEnvelopes. */
template <typename T, class Task>
void withEnvelopes(const GridWork<T>& work, const ChannelWork<T>* channels, int count,
                   GridScratch<T>& scratch, const Task& task) {
    if (channels[0].factors)
        task(SharedEnvelopes<T>(work, channels, count, scratch));
    else
        task(OwnEnvelopes<T>(work, channels, count, scratch));
}

/** Transform forces along x, let the fluid respond, and transform back. */
template <typename T>
void solveRow(const GridWork<T>& work, const ChannelWork<T>* channels, int count, int y,
              double viscosity, GridScratch<T>& scratch) {
    const ScopedTimer timer(scratch.seconds.transforms);
    // Modes of rows are twice as large; a forward and a backward transform multiply by the number
    // of nodes.
    const double scale = 0.5 / (viscosity * work.layout.shape.numNodes());
    withEnvelopes(work, channels, count, scratch, [&](const auto& columns) {
        for (int z = 0; z < work.layout.numModes; z++) {
            columns.gather(y, z);
            project<false>(columns, y, z, scale);
            columns.scatter(y, z);
        }
    });
}

/** Let the root of the fluid's response act on random numbers, and transform back along x. */
inline void drawRow(const GridWork<double>& work, const ChannelWork<double>* channels, int count,
                    int y, double viscosity, const ModeNoise& noise, GridScratch<double>& scratch) {
    const GridShape& shape = work.layout.shape;
    const size_t size = shape.size[0];
    scratch.noise.resize(2 * 3 * size);
    const auto numbers = reinterpret_cast<std::complex<double>*>(scratch.noise.data());
    const double scale = 1 / std::sqrt(viscosity * shape.numNodes());
    withEnvelopes(work, channels, count, scratch, [&](const auto& columns) {
        for (int z = 0; z < work.layout.numModes; z++) {
            if (!shape.isNyquist(1, y)) {
                noise.fill(work.waveIndices, size, shape.waveIndex(1, y), z, numbers);
                for (int c = 0; c < 3; c++)
                    std::memcpy(columns.flow[c], numbers + c * size,
                                size * sizeof(std::complex<double>));
            }
            const ScopedTimer timer(scratch.seconds.transforms);
            project<true>(columns, y, z, scale);
            columns.scatter(y, z);
        }
    });
}

/**
 * CounterModeNoise::fill() for packs of modes.
 *
 * @param ofPlane  whether modes with opposite nx and ny have conjugate numbers for any nz
 */
inline void fillModes(const NoiseStream& noise, uint32_t purpose, const int* nx, int count, int ny,
                      int nz, bool ofPlane, std::complex<double>* numbers) {
    const int width = lanes(Pack(0.0));
    const double half = std::sqrt(0.5);
    for (int i = 0; i < count; i += width) {
        int index[BodySet::blockSize] = {0};
        double sign[BodySet::blockSize] = {0};
        const int valid = std::min(width, count - i);
        for (int k = 0; k < valid; k++) {
            const int s = CounterModeNoise::isMirrored(nx[i + k], ny, ofPlane ? 0 : nz) ? -1 : 1;
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

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin

#endif
