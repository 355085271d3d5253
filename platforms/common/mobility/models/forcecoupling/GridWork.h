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
 * Modes along z whose columns along y are gathered at once. The pieces of rows are then long enough
 * for efficient memory access.
 */
constexpr int modesAtOnce = 8;
/** Numbers of the averages over a slice: a velocity and an angular velocity, or a gradient. */
constexpr int numbersOfPart = 9;

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
    AlignedArrayOf<T> channels;     // columns of a channel and of their sum
    AlignedArrayOf<T> flows, sums;  // between planes: all kz of two rows, and sums over them
    GridSeconds seconds;

    GridSlab<T> nodes(const GridLayout& layout) {
        T* const first = slab.data();
        return {{first, first + layout.slabNumbers(), first + 2 * layout.slabNumbers()}};
    }
};

/** Adds the seconds of its life to a number of GridSeconds, without those of transforms. */
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

/** The transforms there and back. */
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
    bool streams;            // whether modes are too many for caches
};

/** A channel, with its own modes. Particles with envelopes of their own are one without factors. */
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
