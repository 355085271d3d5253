#ifndef RIGIDHI_GRID_SHAPE_H_
#define RIGIDHI_GRID_SHAPE_H_

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <memory>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

class GridPlanes;
class GridWalls;

/**
 * How far the edges of a triclinic box lean. Grids and cells of such a box are rectangular in the
 * coordinates x' = T x, which follow the edges; T has the rows (1, xy, xz), (0, 1, yz), (0, 0, 1).
 * Volumes are the same in both. The wave with the numbers n has the wave vector k = T^T k' with
 * k'_i = 2 pi n_i/edge_i.
 */
struct GridSkew {
    double xy = 0, xz = 0, yz = 0;

    GridSkew() = default;
    explicit GridSkew(const BoxVectors& box)
        : xy(-box[1][0] / box[1][1]),
          xz((-box[2][0] + box[1][0] / box[1][1] * box[2][1]) / box[2][2]),
          yz(-box[2][1] / box[2][2]) {}
    OpenMM::Vec3 toGrid(const OpenMM::Vec3& x) const {
        return OpenMM::Vec3(x[0] + (xy * x[1] + xz * x[2]), x[1] + yz * x[2], x[2]);
    }
    OpenMM::Vec3 fromGrid(const OpenMM::Vec3& x) const {
        const double y = x[1] - yz * x[2];
        return OpenMM::Vec3(x[0] - (xy * y + xz * x[2]), y, x[2]);
    }
    /** T */
    Eigen::Matrix3d matrix() const {
        Eigen::Matrix3d T;
        T << 1, xy, xz, 0, 1, yz, 0, 0, 1;
        return T;
    }
    bool isNone() const { return xy == 0 && xz == 0 && yz == 0; }
    bool operator==(const GridSkew& other) const {
        return xy == other.xy && xz == other.xz && yz == other.yz;
    }
};

/**
 * The lattice of a box by the vectors that are nearest to those of another box. A box that is
 * sheared past a tilt of half an edge goes on with the other tilt of its lattice, and waves and
 * coordinates of the vectors that this gives go on smoothly.
 */
BoxVectors vectorsNearTo(const BoxVectors& other, BoxVectors box);

/**
 * What the waves of a triclinic box need of a grid in the coordinates of GridSkew. A box that leans
 * along one axis only has the numbers of one that leans by half an edge, so that a box has one grid
 * while it is sheared.
 */
struct GridLean {
    explicit GridLean(const BoxVectors& box);
    /** |a_i|/edge_i: how many more nodes an edge needs, since |k'_i| <= stretch_i |k|. */
    std::array<double, 3> stretch = {1, 1, 1};
    /** The largest |k'|^2/k^2: by how much faster than k says the Gaussian of a wave falls. */
    double squares = 1;
    /** Whether boxes have the same edges and need the same. */
    static bool isShared(const BoxVectors& one, const BoxVectors& other);
};

/**
 * A grid over a periodic box. Nodes are at multiples of the spacing, and z runs fastest. In a
 * triclinic box this holds in the coordinates of GridSkew; only channels (GridChannel) have grids
 * there. Their modes are those with |k| up to longestWave(), because the other ones depend on which
 * of several vectors the lattice is given by.
 *
 * A mirrored grid is that of a fluid between slip walls at y = 0 and at half the edge along y.
 * Flows and forces are their own reflections there, so the nodes between the walls determine all
 * others. Nodes are half a spacing away from the walls, because sums of cosines and sines at such
 * nodes are transforms of half the length. The size along y is even.
 *
 * A grid with planes z = const is that of a fluid which these planes confine. Its edge along z is
 * not a period of that fluid.
 */
struct GridShape {
    std::array<int, 3> size = {0, 0, 0};     // nodes along each axis
    std::array<double, 3> edge = {0, 0, 0};  // nm
    GridSkew skew;
    bool mirrored = false;
    std::shared_ptr<const GridPlanes> planes;
    /** Of channels (GridChannel), which need other functions. */
    std::shared_ptr<const GridWalls> walls;

    double spacing(int axis) const { return edge[axis] / size[axis]; }
    double volume() const { return edge[0] * edge[1] * edge[2]; }
    long long numNodes() const { return (long long)size[0] * size[1] * size[2]; }
    /**
     * Rows of nodes along y that determine all others. On a mirrored grid these are the rows
     * between the walls, which are as many as its modes with ky >= 0.
     */
    int numRows() const { return mirrored ? size[1] / 2 : size[1]; }
    /** The place of the first node along an axis, nm. */
    double firstNode(int axis) const { return mirrored && axis == 1 ? 0.5 * spacing(axis) : 0; }
    /**
     * Complex numbers in a row of modes: those with kz from 0 up. The others are their conjugates.
     */
    int numRowModes() const { return size[2] / 2 + 1; }
    /** The integer wave number of an index, from -size/2 on. */
    int waveIndex(int axis, int index) const {
        return 2 * index < size[axis] ? index : index - size[axis];
    }
    /** Of a box with edges along the axes; in a triclinic box it is a component of k' (GridSkew).
     */
    double waveNumber(int axis, int index) const;
    /** The wave vector of the mode with these indices. */
    std::array<double, 3> waveVector(int x, int y, int z) const {
        const double kx = waveNumber(0, x), ky = waveNumber(1, y);
        return {kx, ky + skew.xy * kx, waveNumber(2, z) + (skew.yz * ky + skew.xz * kx)};
    }
    /** The indices of the mode with this wave vector of the lattice, 1/nm, from -size/2 on. */
    std::array<int, 3> indicesOf(const std::array<double, 3>& waveVector) const;
    /** Whether that mode is on the grid and not left out. */
    bool carries(const std::array<double, 3>& waveVector) const;
    /** The wave number up to which all waves of the lattice are modes of the grid, 1/nm. */
    double longestWave() const;
    /**
     * Whether an index is that of the Nyquist plane. No grid tells the modes of this plane from
     * their mirror images, so they are left out.
     */
    bool isNyquist(int axis, int index) const { return 2 * index == size[axis]; }
    bool operator==(const GridShape& other) const {
        return size == other.size && edge == other.edge && skew == other.skew &&
               mirrored == other.mirrored && planes == other.planes && walls == other.walls;
    }
};

/** How fine a grid must be, and how far envelopes reach, for particles and a tolerance. */
class GridResolution {
public:
    /**
     * @param tolerance  of products: the norm of their error over the norm of the mobility, both
     *     scaled by the square roots of the particles' own mobilities
     * @param spacing  nm; 0: the spacing that the tolerance needs
     */
    GridResolution(const HydrodynamicParticles& particles, double tolerance, double spacing);
    /**
     * The resolution for points whose force envelopes have this width and end at this distance, nm,
     * on a grid that the caller has chosen.
     */
    static GridResolution ofPoints(double width, double cutoff) {
        return GridResolution(cutoff / width);
    }
    /** The largest spacing that keeps the tolerance, nm. */
    double getSpacing() const { return spacing; }
    /**
     * The tolerance that belongs to the spacing: the one asked for, unless the user has set another
     * spacing.
     */
    double getTolerance() const { return tolerance; }
    /** The spacing at which products have no correct digit left, nm: that of a tolerance of 0.5. */
    double getCoarsestSpacing() const { return coarsest; }
    /** The distance at which the envelopes of a particle of this radius are cut off. */
    double cutoff(double radius) const;
    /** The grid for a box, which depends on nothing else. */
    GridShape shapeFor(const BoxVectors& box) const;
    /**
     * The width of the Gaussian that particles spread in a triclinic box, nm. Factors of modes make
     * up for what the envelopes of particles are wider.
     */
    double widthIn(const GridLean& lean) const { return narrowest / std::sqrt(lean.squares); }
    double getCutoffInWidths() const { return cutoffInWidths; }
    /**
     * The largest spacing along z of a fluid between planes z = const. The velocities on the planes
     * have an error of a part exp(-(pi width/spacing)^2/2) of an envelope of this width, because
     * only one envelope is there.
     */
    double getSpacingAcross() const { return spacingAcross; }
    /** The grid for a fluid between planes, which are not in it yet. */
    GridShape shapeBetweenPlanes(const BoxVectors& box) const;

private:
    // Below the smallest tolerance, rounding makes a finer grid no better, and an exponential that
    // underflows would have envelopes without end.
    static constexpr double smallestTolerance = 1e-14, largestTolerance = 0.5;
    explicit GridResolution(double cutoffInWidths) : cutoffInWidths(cutoffInWidths) {}
    double spacing = 0, spacingAcross = 0, tolerance = 0, coarsest = 0, narrowest = 0,
           cutoffInWidths;
};

/** More nodes along an edge than any grid has: checkSizeOfGrid() refuses so many. */
const int tooManyNodes = 1 << 20;

/**
 * The smallest even number, at least `least`, without prime factors above 7. Transforms of such a
 * length are fast. It is `tooManyNodes` at most.
 */
int nextGridSize(double least);
/** Likewise the smallest odd number. */
int nextOddGridSize(double least);

}  // namespace RigidHIPlugin

#endif
