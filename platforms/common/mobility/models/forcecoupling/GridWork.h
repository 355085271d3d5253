#ifndef RIGIDHI_GRID_WORK_H_
#define RIGIDHI_GRID_WORK_H_

#include <array>

#include "linearalgebra/AlignedArray.h"
#include "mobility/GridSeconds.h"
#include "mobility/models/forcecoupling/FourierPlan.h"
#include "mobility/models/forcecoupling/GridChannels.h"

namespace RigidHIPlugin {

constexpr int slabWidth = GridStencils::slabWidth;
/** Numbers for a mode of all planes of a slab, real and imaginary parts alternating. */
constexpr int modeWidth = 2 * slabWidth;
/**
 * The number of modes along z whose columns along y are gathered at once. The pieces of rows are
 * then long enough for efficient memory access.
 */
constexpr int modesAtOnce = 8;
/** Numbers in the average over a slice: a velocity and an angular velocity, or a gradient. */
constexpr int numbersOfPart = 9;

/**
 * The layout of a grid in memory.
 *
 * A mirrored grid has the rows between the walls, and those outer rows beyond the walls that
 * stencils reach. Outer rows are reflections of inner rows.
 */
struct GridLayout {
    GridShape shape;
    int numSlabs = 0;   // along x
    int numRows = 0;    // along y, without outer rows; a mirrored grid has as many modes along y
    int reach = 0;      // number of outer rows on each side
    int numModes = 0;   // kz from 0 on, without the Nyquist index
    int rowLength = 0;  // nodes of a row, or twice its modes

    GridLayout() {}
    GridLayout(const GridStencils& stencils) : shape(stencils.getShape()) {
        const std::array<int, 3>& n = shape.size;
        numSlabs = GridStencils::slabsOf(shape);
        numRows = shape.numRows();
        // Each side of the centre has half of a stencil, and the centre is between the walls.
        if (shape.mirrored) reach = std::min(numRows, stencils.largestWidth(1) / 2);
        numModes = (n[2] + 1) / 2;
        // Stencils that cross the end of a row continue beyond the end.
        rowLength = std::max(n[2] + stencils.largestWidth(2), 2 * numModes);
        rowLength += rowLength % 2;  // whole cache lines in both precisions
    }
    size_t rowNumbers() const { return (size_t)rowLength * slabWidth; }
    /**
     * The number of rows in memory: the rows of the grid, the outer rows above, the outer rows
     * below. If stencils are so long that the outer rows of both sides meet, these are all rows of
     * the period.
     */
    int storedRows() const { return std::min(shape.size[1], numRows + 2 * reach); }
    /** The index in memory of a row of the period. */
    int place(int y) const {
        while (y >= shape.size[1]) y -= shape.size[1];
        return y < shape.size[1] - reach ? y : y - (shape.size[1] - storedRows());
    }
    /**
     * Call visit(row, outer) with the index of each outer row and of the inner row that it
     * reflects.
     */
    template <class Visit>
    void forOuterRows(const Visit& visit) const {
        for (int i = 0; i < reach; i++) {
            visit(numRows - 1 - i, place(numRows + i));
            // Where the outer rows meet, this row was already visited as one of the rows above.
            if (shape.size[1] - 1 - i >= numRows + reach) visit(i, place(shape.size[1] - 1 - i));
        }
    }
    size_t slabNumbers() const { return storedRows() * rowNumbers(); }
    /** Numbers in a column of modes along x, padded to whole slabs. Columns are contiguous. */
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
    AlignedArrayOf<T> channels;     // columns of a channel and of their sum
    AlignedArrayOf<T> flows, sums;  // between planes: all kz of two rows, and sums over kz
    GridSeconds seconds;

    GridSlab<T> nodes(const GridLayout& layout) {
        T* const first = slab.data();
        return {{first, first + layout.slabNumbers(), first + 2 * layout.slabNumbers()}};
    }
};

/**
 * Adds the seconds from its construction to its destruction, without those of transforms, to a
 * number of GridSeconds.
 */
class TimeBesideTransforms {
public:
    TimeBesideTransforms(GridSeconds& all, double& seconds)
        : all(all), seconds(seconds), before(all.transforms), whole(seconds) {}
    ~TimeBesideTransforms() { seconds -= all.transforms - before; }

private:
    const GridSeconds& all;
    double& seconds;
    const double before;
    const ScopedTimer whole;
};

/** The forward and backward transforms. */
template <typename T>
struct GridPlans {
    FourierPlan<T> there, back;
};

/** The data that all threads share while they work on products or fields. */
template <typename T>
struct GridWork {
    const GridLayout& layout;
    const GridPlans<T>* plans;  // along each axis
    const T *kx, *keepsX;  // wave numbers of each x, and 0 for the Nyquist index and padding, else
                           // 1; each twice
    const int* waveIndices;  // of each x
    const T* halfTurns;      // for a mirrored grid, cos and sin of pi m/(2 rows) for each ky
    bool streams;            // whether the modes are too large for caches
};

/**
 * A channel with its own modes. Particles with their own envelopes are a channel without factors.
 */
template <typename T>
struct ChannelWork {
    const GridStencils* stencils;
    const GridFactors* factors;
    bool ofTorques;
    double faxen;
    bool ofDipoles;
    int numRows;  // numbers of its particles
    T* modes[3];
};

}  // namespace RigidHIPlugin

#endif
