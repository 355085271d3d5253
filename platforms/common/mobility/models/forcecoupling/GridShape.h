#ifndef RIGIDHI_GRID_SHAPE_H_
#define RIGIDHI_GRID_SHAPE_H_

#include <array>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * A grid over a periodic box with edges along the axes. Nodes are at multiples of the spacing, z
 * runs fastest.
 *
 * A mirrored grid is that of a fluid between slip walls at y = 0 and half the edge along y: flows
 * and forces are their own reflections there, so the nodes between the walls tell all. Nodes are
 * half a spacing away from the walls, for sums of cosines and sines of such nodes are transforms of
 * half the length. The size along y is even.
 */
struct GridShape {
    std::array<int, 3> size = {0, 0, 0};     // nodes along each axis
    std::array<double, 3> edge = {0, 0, 0};  // nm
    bool mirrored = false;

    double spacing(int axis) const { return edge[axis] / size[axis]; }
    double volume() const { return edge[0] * edge[1] * edge[2]; }
    long long numNodes() const { return (long long)size[0] * size[1] * size[2]; }
    /** Rows of nodes along y that tell all: of a mirrored grid those between the walls, which are
     * as many as its modes with ky >= 0. */
    int numRows() const { return mirrored ? size[1] / 2 : size[1]; }
    /** The place of the first node along an axis, nm. */
    double firstNode(int axis) const { return mirrored && axis == 1 ? 0.5 * spacing(axis) : 0; }
    /** Complex numbers in a row of modes: kz from 0 up, the others are their conjugates. */
    int numRowModes() const { return size[2] / 2 + 1; }
    /** The integer wave number of an index, from -size/2 on. */
    int waveIndex(int axis, int index) const {
        return 2 * index < size[axis] ? index : index - size[axis];
    }
    double waveNumber(int axis, int index) const;
    /** Whether an index is of the Nyquist plane, whose modes no grid tells from their mirror
     * images: they are left out. */
    bool isNyquist(int axis, int index) const { return 2 * index == size[axis]; }
    bool operator==(const GridShape& other) const {
        return size == other.size && edge == other.edge && mirrored == other.mirrored;
    }
};

/** How fine a grid must be, and how far envelopes reach, for particles and a tolerance. */
class GridResolution {
public:
    /**
     * @param tolerance  of products: norm of their error over the norm of the mobility, both over
     * the roots of the particles' own mobilities
     * @param spacing    nm; 0: as the tolerance wants
     */
    GridResolution(const HydrodynamicParticles& particles, double tolerance, double spacing);
    /** For points whose force envelopes of this width end at this distance, on a grid that somebody
     * else has chosen; nm. */
    static GridResolution ofPoints(double width, double cutoff) {
        return GridResolution(cutoff / width);
    }
    /** The largest spacing that will do, nm. */
    double getSpacing() const { return spacing; }
    /** The tolerance that the spacing means: the one asked for, unless the user has set another
     * spacing. */
    double getTolerance() const { return tolerance; }
    /** The spacing at which products have no digit left, nm: that of a tolerance of 0.5. */
    double getCoarsestSpacing() const { return coarsest; }
    /** The distance at which the envelopes of a particle of this radius are cut off. */
    double cutoff(double radius) const;
    /** The grid for a box, which depends on nothing else. */
    GridShape shapeFor(const BoxVectors& box) const;

private:
    // Rounding: a finer grid is not better, and an exponential that underflows would have envelopes
    // without end.
    static constexpr double smallestTolerance = 1e-14, largestTolerance = 0.5;
    explicit GridResolution(double cutoffInWidths) : cutoffInWidths(cutoffInWidths) {}
    double spacing = 0, tolerance = 0, coarsest = 0, cutoffInWidths;
};

/** The least even number from `least` up without prime factors above 7, for which transforms are
 * fast. */
int nextGridSize(double least);

}  // namespace RigidHIPlugin

#endif
