#ifndef RIGIDHI_GRID_STENCILS_H_
#define RIGIDHI_GRID_STENCILS_H_

#include <algorithm>
#include <cmath>
#include <vector>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/**
 * The nodes to which particles spread forces, and over which they average, with the factors of the
 * weights along each axis.
 *
 * The grid is cut into slabs of slabWidth planes across x, and a particle's nodes into slices, one
 * for each slab that it reaches. The nodes of a slice are the planes of the slab times certain rows
 * and nodes along y and z. These are the ones that a ball about an anchor has in its nearest plane.
 * The anchor is the accepted position of the particle. The nodes stay while a finite difference
 * moves the particle a little, because a node more or less would be a jump of the size of the
 * tolerance.
 *
 * Weights are never renormalised: averaging is the transpose of spreading. Where a ball is larger
 * than the box, several of its nodes are the same node of the grid, and weights add up. On a
 * mirrored grid particles have their centres between the walls, and no images. The code that
 * spreads and averages reflects the nodes.
 */
class GridStencils {
public:
    GridStencils(const HydrodynamicParticles& particles, const GridResolution& resolution);
    /** Prepare the weights for a grid, without positions yet. */
    void layOut(const GridShape& shape);
    /**
     * Move to these positions, nm, not wrapped. Anchors move there too, unless they are to be kept
     * and are within a tenth of the spacing.
     */
    void moveTo(const GridShape& shape, const std::vector<OpenMM::Vec3>& positions,
                bool keepAnchors);

    const HydrodynamicParticles& getParticles() const { return particles; }
    const GridShape& getShape() const { return shape; }
    int size() const { return stencils.size(); }
    int largestWidth(int axis) const { return largest[axis]; }

    /** The planes of a slab: as many as packs have lanes. The last slab may have fewer. */
    static constexpr int slabWidth = 8;
    static int slabsOf(const GridShape& shape) {
        return (shape.size[0] + slabWidth - 1) / slabWidth;
    }
    int planesOf(int slab) const { return std::min(slabWidth, shape.size[0] - slabWidth * slab); }

    /**
     * One particle's stencil: `width` nodes along each axis from `first` on. `first` is from 0 to
     * size - 1, and the caller wraps the nodes.
     */
    struct alignas(64) Stencil {
        int first[3] = {0, 0, 0};
        int width[3] = {0, 0, 0};
        double anchor[3] = {0, 0, 0};  // from the first node, nm
        double cutoff = 0;             // nm
        size_t weights = 0;            // where the stencil's numbers begin
    };
    const Stencil& operator[](int particle) const { return stencils[particle]; }

    /**
     * Kinds of weights along an axis: of the force envelope and of its derivative by the distance,
     * of the torque envelope and of its derivative.
     */
    enum Kind { Force, ForceSlope, Torque, TorqueSlope };
    /**
     * Weights of a kind along an axis, one for each node of the stencil. The product of three is
     * the envelope times the square root of a node's volume, so that averaging is the transpose of
     * spreading. Torque kinds exist only for particles with torque. Along x there are slabWidth
     * zeros before the weights and after them.
     */
    const double* weightsOf(int particle, int axis, Kind kind) const {
        const Stencil& s = stencils[particle];
        const int before[3] = {slabWidth, s.width[0] + 2 * slabWidth,
                               s.width[0] + 2 * slabWidth + s.width[1]};
        return &weights[s.weights + kind * numbersOfKind(s) + before[axis]];
    }

    /** Nodes from `begin` up to before `end`. */
    struct Range {
        int begin, end;
    };
    /**
     * The part of a slab that a particle reaches: its node `offset` + i along x is in plane i of
     * the slab. `offset` may be negative. There are no nodes below 0 or from the width on.
     */
    struct Slice {
        int particle, offset;
        size_t rows;
    };
    /**
     * The number of rows in a tile. Particles that begin in the same tile follow each other by
     * their positions along z. There are so few rows that all that these particles reach stays in
     * the first cache.
     */
    static constexpr int rowsOfTile = 4;
    /**
     * The first row that later slices of a slab reach at the earliest, apart from rows across the
     * end.
     */
    int firstRowOfTile(const Slice& slice) const {
        return stencils[slice.particle].first[1] / rowsOfTile * rowsOfTile;
    }
    /**
     * The slices of a slab, sorted by tiles of first rows, have the numbers from beginOfSlab(slab)
     * up to before beginOfSlab(slab + 1).
     */
    int beginOfSlab(int slab) const { return slabs[slab]; }
    int numSlices() const { return slices.size(); }
    const Slice& slice(int number) const { return slices[number]; }
    /** The nodes along z that a slice has in row j along y of its stencil. */
    const Range& nodesOf(const Slice& slice, int j) const { return ranges[slice.rows + j]; }
    /** The numbers of a particle's slices, by slabs. */
    Range slicesOf(int particle) const { return {firstSlice[particle], firstSlice[particle + 1]}; }
    int sliceNumber(int i) const { return sliceNumbers[i]; }
    /** Prefetch into the cache the data that slices with later numbers need. */
    void prefetchAfter(int number) const {
        const int last = slices.size() - 1, soon = 4, later = 10;
        __builtin_prefetch(&stencils[slices[std::min(last, number + later)].particle]);
        const Stencil& s = stencils[slices[std::min(last, number + soon)].particle];
        const char* w = reinterpret_cast<const char*>(&weights[s.weights]);
        const int bytes = numbersOfKind(s) * sizeof(double), most = 512, line = 64;
        for (int at = 0; at < bytes && at < most; at += line) __builtin_prefetch(w + at);
    }

private:
    /**
     * The nodes, at multiples of the spacing, that are no farther from the centre than the root of
     * `square`.
     */
    static Range within(double square, double centre, double spacing, int width) {
        if (!(square >= 0)) return {0, 0};
        const double half = std::sqrt(square);
        const int begin = std::max(0, (int)std::ceil((centre - half) / spacing)),
                  end = std::min(width, (int)std::floor((centre + half) / spacing) + 1);
        return {begin, std::max(begin, end)};
    }
    static size_t numbersOfKind(const Stencil& s) {
        return s.width[0] + 2 * slabWidth + s.width[1] + s.width[2];
    }
    int kinds(int particle) const { return particles.hasTorque[particle] ? 4 : 2; }
    bool isNear(const OpenMM::Vec3& offset) const;
    template <class Visit>
    void forSlabs(int particle, const Visit& visit) const;
    void sortSlices();
    void cutBall(Slice& slice, int planes);
    void anchor(int particle, const OpenMM::Vec3& position);
    void weigh(int particle, const OpenMM::Vec3& offset);

    const HydrodynamicParticles& particles;
    const GridResolution& resolution;
    GridShape shape;
    std::vector<OpenMM::Vec3> anchors;  // in the coordinates of GridSkew, not wrapped
    std::vector<Stencil> stencils;
    std::vector<double> weights;
    std::vector<int> slabs, firstSlice, sliceNumbers, nextOfSlab, byRows;
    std::vector<Slice> slices;
    std::vector<Range> ranges;  // for each slice, one row of its stencil after the other
    int largest[3] = {0, 0, 0};
};

}  // namespace RigidHIPlugin

#endif
