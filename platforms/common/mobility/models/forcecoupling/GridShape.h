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
 * The tilt of the edges of a triclinic box. Grids and cells of such a box are rectangular in the
 * coordinates x' = T x, which follow the edges; T has the rows (1, xy, xz), (0, 1, yz), (0, 0, 1)
 * and preserves volumes. The wave with the numbers n has the wave vector k = T^T k' with
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
 * The lattice of a box, given by the vectors nearest to those of another box. A box sheared past a
 * tilt of half an edge continues with the other tilt of its lattice. With the vectors of this
 * function, waves and coordinates still change smoothly.
 */
BoxVectors vectorsNearTo(const BoxVectors& other, BoxVectors box);

/**
 * The requirements of the waves of a triclinic box on a grid in the coordinates of GridSkew. A box
 * tilted along one axis only has the numbers of a box tilted by half an edge, so a box keeps one
 * grid while it is sheared.
 */
struct GridLean {
    explicit GridLean(const BoxVectors& box);
    /**
     * |a_i|/edge_i: the factor by which an edge needs more nodes, because |k'_i| <= stretch_i |k|.
     */
    std::array<double, 3> stretch = {1, 1, 1};
    /**
     * The largest |k'|^2/k^2: the factor by which the exponent of a wave's Gaussian exceeds that
     * for k.
     */
    double squares = 1;
    /** Whether boxes have the same edges and the same requirements. */
    static bool isShared(const BoxVectors& one, const BoxVectors& other);
};

/**
 * A grid over a periodic box. Nodes are at multiples of the spacing, and z runs fastest. In a
 * triclinic box this holds in the coordinates of GridSkew; only channels (GridChannel) have grids
 * there. Their modes are those with |k| up to longestWave(). Other modes would depend on the choice
 * of vectors for the lattice.
 *
 * A mirrored grid is for a fluid between slip walls at y = 0 and at half the edge along y. Flows
 * and forces are their own reflections there, so the nodes between the walls determine all other
 * nodes. Nodes are half a spacing away from the walls, because sums of cosines and sines at such
 * nodes are transforms of half the length. The size along y is even.
 *
 * A grid with planes z = const is for a fluid confined by these planes. Its edge along z is not a
 * period of this fluid.
 */
struct GridShape {
    std::array<int, 3> size = {0, 0, 0};     // nodes along each axis
    std::array<double, 3> edge = {0, 0, 0};  // nm
    GridSkew skew;
    bool mirrored = false;
    std::shared_ptr<const GridPlanes> planes;
    /** The walls for channels (GridChannel), which need other functions. */
    std::shared_ptr<const GridWalls> walls;

    double spacing(int axis) const { return edge[axis] / size[axis]; }
    double volume() const { return edge[0] * edge[1] * edge[2]; }
    long long numNodes() const { return (long long)size[0] * size[1] * size[2]; }
    /**
     * The number of rows of nodes along y that determine all others. On a mirrored grid these are
     * the rows between the walls, as many as its modes with ky >= 0.
     */
    int numRows() const { return mirrored ? size[1] / 2 : size[1]; }
    /** The coordinate of the first node along an axis, nm. */
    double firstNode(int axis) const { return mirrored && axis == 1 ? 0.5 * spacing(axis) : 0; }
    /** The number of modes in a row: those with kz >= 0. The others are their conjugates. */
    int numRowModes() const { return size[2] / 2 + 1; }
    /** The integer wave number of an index, from -size/2 on. */
    int waveIndex(int axis, int index) const {
        return 2 * index < size[axis] ? index : index - size[axis];
    }
    /** A component of the wave vector; in a triclinic box a component of k' (GridSkew). */
    double waveNumber(int axis, int index) const;
    /** The wave vector of the mode with these indices. */
    std::array<double, 3> waveVector(int x, int y, int z) const {
        const double kx = waveNumber(0, x), ky = waveNumber(1, y);
        return {kx, ky + skew.xy * kx, waveNumber(2, z) + (skew.yz * ky + skew.xz * kx)};
    }
    /** The indices of the mode with this wave vector of the lattice, 1/nm, from -size/2 on. */
    std::array<int, 3> indicesOf(const std::array<double, 3>& waveVector) const;
    /** Whether the grid has that mode and does not exclude it. */
    bool carries(const std::array<double, 3>& waveVector) const;
    /** The wave number up to which the grid has all waves of the lattice as modes, 1/nm. */
    double longestWave() const;
    /**
     * Whether an index is that of the Nyquist plane. A grid cannot distinguish the modes of this
     * plane from their mirror images, so it excludes them.
     */
    bool isNyquist(int axis, int index) const { return 2 * index == size[axis]; }
    bool operator==(const GridShape& other) const {
        return size == other.size && edge == other.edge && skew == other.skew &&
               mirrored == other.mirrored && planes == other.planes && walls == other.walls;
    }
};

/** The spacing of a grid and the reach of envelopes, for particles and a tolerance. */
class GridResolution {
public:
    /**
     * @param tolerance  of products: the norm of their error over the norm of the mobility, both
     *     scaled by the square roots of the particles' own mobilities
     * @param spacing  nm; 0 for the spacing that the tolerance needs
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
     * The tolerance that belongs to the spacing: that of the constructor, unless the user has set
     * another spacing.
     */
    double getTolerance() const { return tolerance; }
    /**
     * The spacing at which products have no correct digit left, nm: the spacing for a tolerance of
     * 0.5.
     */
    double getCoarsestSpacing() const { return coarsest; }
    /** The distance at which the envelopes of a particle of this radius are cut off. */
    double cutoff(double radius) const;
    /** The grid for a box. It depends on nothing else. */
    GridShape shapeFor(const BoxVectors& box) const;
    /**
     * The width of the Gaussian that particles spread in a triclinic box, nm. Factors of modes
     * correct for the wider envelopes of particles.
     */
    double widthIn(const GridLean& lean) const { return narrowest / std::sqrt(lean.squares); }
    double getCutoffInWidths() const { return cutoffInWidths; }
    /**
     * The largest spacing along z of a fluid between planes z = const. The velocities on the planes
     * have the relative error exp(-(pi width/spacing)^2/2) for an envelope of this width, because
     * only one envelope takes part.
     */
    double getSpacingAcross() const { return spacingAcross; }
    /** The grid for a fluid between planes, still without the planes. */
    GridShape shapeBetweenPlanes(const BoxVectors& box) const;

private:
    // Below the smallest tolerance, rounding makes a finer grid no better, and an underflowing
    // exponential would give infinite envelopes.
    static constexpr double smallestTolerance = 1e-14, largestTolerance = 0.5;
    explicit GridResolution(double cutoffInWidths) : cutoffInWidths(cutoffInWidths) {}
    double spacing = 0, spacingAcross = 0, tolerance = 0, coarsest = 0, narrowest = 0,
           cutoffInWidths;
};

/** More nodes along an edge than any grid has: checkSizeOfGrid() refuses this number. */
const int tooManyNodes = 1 << 20;

/**
 * The smallest even number, at least `least` and at most `tooManyNodes`, without prime factors
 * above 7. Transforms of such a length are fast.
 */
int nextGridSize(double least);
/** Likewise the smallest odd number. */
int nextOddGridSize(double least);

}  // namespace RigidHIPlugin

#endif
