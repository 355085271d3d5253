#ifndef RIGIDHI_GRID_STENCILS_H_
#define RIGIDHI_GRID_STENCILS_H_

#include <algorithm>
#include <cmath>
#include <vector>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/**
 * The nodes to which particles spread forces, and over which they average, with the factors of the weights along each axis.
 *
 * The nodes are those in a ball about an anchor, the accepted position of the particle, and what makes packs of eight along z whole. They stay while a finite
 * difference moves it a little, for a node more or less would be a jump of the size of the tolerance. Weights are never renormalised: averaging is the
 * transpose of spreading. Where a ball is larger than the box, several of its nodes are the same node of the grid, and weights add up.
 */
class GridStencils {
public:
    GridStencils(const HydrodynamicParticles& particles, const GridResolution& resolution);
    /** Make weights for a grid, without positions yet. */
    void layOut(const GridShape& shape);
    /** To these positions, nm, not wrapped; anchors go there too, unless they are to be kept and are within a tenth of the spacing. */
    void moveTo(const GridShape& shape, const std::vector<OpenMM::Vec3>& positions, bool keepAnchors);

    const HydrodynamicParticles& getParticles() const { return particles; }
    const GridShape& getShape() const { return shape; }
    int size() const { return stencils.size(); }
    int largestWidth(int axis) const { return largest[axis]; }

    /**
     * One particle's stencil: `width` nodes along each axis from `first` on (from 0 to size - 1, wrapping is the caller's). Along z both are multiples of
     * `padding`, so that packs of nodes begin where cache lines do. Its numbers are together, since slices ask for them in the order of planes.
     */
    struct alignas(64) Stencil {
        int first[3] = {0, 0, 0};
        int width[3] = {0, 0, 0};
        double anchor[3] = {0, 0, 0};  // from the first node, nm
        double cutoff = 0;             // nm
        size_t weights = 0;            // where its numbers begin in weightsOf()
    };
    const Stencil& operator[](int particle) const { return stencils[particle]; }

    /** Kinds of weights along an axis: of the force envelope and its derivative by the distance, of the torque envelope and its. */
    enum Kind { Force, ForceSlope, Torque, TorqueSlope };
    /**
     * Weights of a kind along an axis, one a node of the stencil. The product of three is the envelope times the root of a node's volume, so that averaging
     * is the transpose of spreading. Torque kinds: only of particles with torque.
     */
    const double* weightsOf(int particle, int axis, Kind kind) const {
        const Stencil& s = stencils[particle];
        const int before[3] = {0, s.width[0], s.width[0] + s.width[1]};
        return &weights[s.weights + kind * (before[2] + s.width[2]) + before[axis]];
    }

    /** A part of a row of nodes, from `begin` up to before `end`. */
    struct Range {
        int begin, end;
    };
    /** The nodes j along y that a plane has of the ball: node `i` along x. */
    Range rowsOf(int particle, int i) const {
        const Stencil& s = stencils[particle];
        const double x = i * shape.spacing(0) - s.anchor[0];
        return within(s.cutoff * s.cutoff - x * x, s.anchor[1], shape.spacing(1), s.width[1]);
    }
    /** The nodes along z above node (i, j): multiples of `padding`. Short rows are taken whole. */
    Range nodesOf(int particle, int i, int j) const {
        const Stencil& s = stencils[particle];
        if (s.width[2] <= 3 * padding) return {0, s.width[2]};
        const double x = i * shape.spacing(0) - s.anchor[0], y = j * shape.spacing(1) - s.anchor[1];
        const Range range = within(s.cutoff * s.cutoff - x * x - y * y, s.anchor[2], shape.spacing(2), s.width[2]);
        return {range.begin / padding * padding, padded(range.end)};
    }

    /** A plane of nodes across x that a stencil has: its node `i` along x. */
    struct Slice {
        int particle, i;
    };
    /** The slices in a plane of the grid, neighbours after each other: those with numbers from beginOfPlane(plane) up to before beginOfPlane(plane + 1). */
    int beginOfPlane(int plane) const { return planes[plane]; }
    const Slice& slice(int number) const { return slices[number]; }
    /** The number of a particle's slice. */
    int sliceOf(int particle, int i) const { return sliceNumbers[firstSlice[particle] + i]; }
    /** Have what slices with later numbers need brought into the cache. */
    void prefetchAfter(int number) const {
        const int last = slices.size() - 1, soon = 3, later = 8;
        __builtin_prefetch(&stencils[slices[std::min(last, number + later)].particle]);
        const Stencil& s = stencils[slices[std::min(last, number + soon)].particle];
        const char* w = reinterpret_cast<const char*>(&weights[s.weights]);
        const int bytes = (s.width[0] + s.width[1] + s.width[2]) * sizeof(double), most = 1024, line = 64;
        for (int at = 0; at < bytes && at < most; at += line) __builtin_prefetch(w + at);
    }

    static constexpr int padding = 8;
    static int padded(int width) { return (width + padding - 1) / padding * padding; }

private:
    /** Nodes at multiples of the spacing that are no farther from the centre than the root of the square. */
    static Range within(double square, double centre, double spacing, int width) {
        if (!(square >= 0)) return {0, 0};
        const double half = std::sqrt(square);
        const int begin = std::max(0, (int)std::ceil((centre - half) / spacing)),
                  end = std::min(width, (int)std::floor((centre + half) / spacing) + 1);
        return {begin, std::max(begin, end)};
    }
    int kinds(int particle) const { return particles.hasTorque[particle] ? 4 : 2; }
    bool isNear(const OpenMM::Vec3& offset) const;
    void sortSlices();
    void anchor(int particle, const OpenMM::Vec3& position);
    void weigh(int particle, const OpenMM::Vec3& offset);

    const HydrodynamicParticles& particles;
    const GridResolution& resolution;
    GridShape shape;
    std::vector<OpenMM::Vec3> anchors;  // not wrapped
    std::vector<Stencil> stencils;
    std::vector<double> weights;
    std::vector<int> planes, firstSlice, sliceNumbers, nextOfPlane, byRows;
    std::vector<Slice> slices;
    int largest[3] = {0, 0, 0};
};

}  // namespace RigidHIPlugin

#endif
