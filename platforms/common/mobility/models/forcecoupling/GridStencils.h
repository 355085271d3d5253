#ifndef RIGIDHI_GRID_STENCILS_H_
#define RIGIDHI_GRID_STENCILS_H_

#include <algorithm>
#include <cmath>
#include <vector>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/**
 * The nodes to which particles spread forces, and over which they average, with the weights along
 * each axis, whose products are the weights of nodes.
 *
 * The grid consists of slabs of slabWidth planes normal to x, and a particle's nodes of slices, one
 * for each slab within its reach. The nodes of a slice are the planes of the slab times certain
 * rows and nodes along y and z: those that a ball about an anchor contains in the plane nearest to
 * the anchor. The anchor is the accepted position of the particle. The nodes stay the same while a
 * finite difference moves the particle a little, because adding or removing a node would change the
 * result by a jump of the size of the tolerance.
 *
 * Weights are never renormalised: averaging is the transpose of spreading. If a ball is larger than
 * the box, several of its nodes are the same node of the grid, and weights add up. On a mirrored
 * grid particles have their centres between the walls, and no images; the code that spreads and
 * averages reflects the nodes.
 */
class GridStencils {
public:
    GridStencils(const HydrodynamicParticles& particles, const GridResolution& resolution);
    /** Prepare the weights for a grid, without positions yet. */
    void layOut(const GridShape& shape);
    /**
     * Move to these positions, nm, not wrapped. Anchors move there, too, unless `keepAnchors` is
     * set and they are within a tenth of the spacing.
     */
    void moveTo(const GridShape& shape, const std::vector<OpenMM::Vec3>& positions,
                bool keepAnchors);

    const HydrodynamicParticles& getParticles() const { return particles; }
    const GridShape& getShape() const { return shape; }
    int size() const { return stencils.size(); }
    int largestWidth(int axis) const { return largest[axis]; }

    /**
     * The number of planes in a slab, equal to the lanes of packs. The last slab may have fewer.
     */
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
        size_t weights = 0;            // index of the stencil's first number
    };
    const Stencil& operator[](int particle) const { return stencils[particle]; }

    /**
     * Kinds of weights along an axis: the force envelope and its derivative by the distance, the
     * torque envelope and its derivative.
     */
    enum Kind { Force, ForceSlope, Torque, TorqueSlope };
    /**
     * Weights of a kind along an axis, one for each node of the stencil. The product of three is
     * the envelope times the square root of a node's volume, so that averaging is the transpose of
     * spreading. Torque kinds exist only for particles with torque. Along x, slabWidth zeros
     * precede and follow the weights.
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
     * The part of a slab within reach of a particle: the particle's node `offset` + i along x is in
     * plane i of the slab. `offset` may be negative. Indices below 0 or from the width on have no
     * node.
     */
    struct Slice {
        int particle, offset;
        size_t rows;
    };
    /**
     * The number of rows in a tile. Particles that begin in the same tile follow one another by
     * their positions along z. With so few rows, all nodes within reach of these particles stay in
     * the first-level cache.
     */
    static constexpr int rowsOfTile = 4;
    /** The first row that later slices of a slab can reach, apart from rows across the end. */
    int firstRowOfTile(const Slice& slice) const {
        return stencils[slice.particle].first[1] / rowsOfTile * rowsOfTile;
    }
    /**
     * The slices of a slab, sorted by tiles of first rows, have the numbers from beginOfSlab(slab)
     * to beginOfSlab(slab + 1) - 1.
     */
    int beginOfSlab(int slab) const { return slabs[slab]; }
    int numSlices() const { return slices.size(); }
    const Slice& slice(int number) const { return slices[number]; }
    /** The nodes along z of a slice in row j along y of its stencil. */
    const Range& nodesOf(const Slice& slice, int j) const { return ranges[slice.rows + j]; }
    /**
     * The range of a particle's slices in the order of slabs; sliceNumber() gives their numbers.
     */
    Range slicesOf(int particle) const { return {firstSlice[particle], firstSlice[particle + 1]}; }
    int sliceNumber(int i) const { return sliceNumbers[i]; }
    /** Prefetch the data of later slices into the cache. */
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
     * The nodes, at multiples of the spacing, at most the root of `square` away from the centre.
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
    std::vector<Range> ranges;  // for each slice, the rows of its stencil one after the other
    int largest[3] = {0, 0, 0};
};

}  // namespace RigidHIPlugin

#endif
