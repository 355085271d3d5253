#include "mobility/models/forcecoupling/GridStencils.h"

#include "mobility/models/forcecoupling/Envelopes.h"

using OpenMM::Vec3;

namespace RigidHIPlugin {

GridStencils::GridStencils(const HydrodynamicParticles& particles, const GridResolution& resolution)
    : particles(particles), resolution(resolution), stencils(particles.size()) {}

void GridStencils::moveTo(const GridShape& newShape, const std::vector<Vec3>& positions,
                          bool keepAnchors) {
    layOut(newShape);
    const bool hasNone = anchors.empty();
    bool moved = hasNone;
    anchors.resize(positions.size());
    for (int p = 0; p < particles.size(); p++) {
        const Vec3 position = shape.skew.toGrid(positions[p]);
        if (!keepAnchors || hasNone || !isNear(position - anchors[p])) {
            anchor(p, position);
            moved = true;
        }
        weigh(p, position - anchors[p]);
    }
    if (moved) sortSlices();
}

bool GridStencils::isNear(const Vec3& offset) const {
    // If the particle is farther away, the ball about the anchor misses nodes that the tolerance
    // needs.
    const double largest = 0.1;
    for (int axis = 0; axis < 3; axis++)
        if (!(std::abs(offset[axis]) <= largest * shape.spacing(axis))) return false;
    return true;
}

void GridStencils::layOut(const GridShape& newShape) {
    if (newShape == shape) return;
    shape = newShape;
    anchors.clear();
    size_t numWeights = 0;
    std::fill(largest, largest + 3, 0);
    for (int p = 0; p < particles.size(); p++) {
        Stencil& s = stencils[p];
        s.cutoff = resolution.cutoff(particles.radii[p]);
        s.weights = numWeights;
        for (int axis = 0; axis < 3; axis++) {
            // The stencil contains every node closer than the cut-off, for any position of the
            // anchor between two nodes.
            s.width[axis] = 2 * (int)std::ceil(s.cutoff / shape.spacing(axis));
            largest[axis] = std::max(largest[axis], s.width[axis]);
        }
        numWeights += kinds(p) * numbersOfKind(s);
    }
    weights.assign(numWeights, 0.0);
}

void GridStencils::anchor(int p, const Vec3& position) {
    Stencil& s = stencils[p];
    anchors[p] = position;
    // Nodes extend beyond the walls as far as particles between the walls reach. A finite
    // difference may lead a little behind a wall.
    if (shape.mirrored) anchors[p][1] = std::min(std::max(position[1], 0.0), 0.5 * shape.edge[1]);
    for (int axis = 0; axis < 3; axis++) {
        const double dx = shape.spacing(axis), L = shape.edge[axis];
        const double x = anchors[p][axis] - shape.firstNode(axis),
                     inBox = x - L * std::floor(x / L);
        const int first = (int)std::floor(inBox / dx) - (int)std::ceil(s.cutoff / dx) + 1;
        s.first[axis] = first % shape.size[axis];
        if (s.first[axis] < 0) s.first[axis] += shape.size[axis];
        s.anchor[axis] = inBox - first * dx;
    }
}

void GridStencils::weigh(int p, const Vec3& offset) {
    const Stencil& s = stencils[p];
    const size_t all = numbersOfKind(s);
    for (int torque = 0; torque < kinds(p) / 2; torque++) {
        const double width = torque ? torqueEnvelopeWidth(particles.radii[p])
                                    : forceEnvelopeWidth(particles.radii[p]);
        const double narrowness = 1 / (width * width);
        for (int axis = 0; axis < 3; axis++) {
            const double dx = shape.spacing(axis), centre = s.anchor[axis] + offset[axis];
            const double scale = std::sqrt(dx) / (std::sqrt(2 * M_PI) * width);
            double* plain = const_cast<double*>(weightsOf(p, axis, torque ? Torque : Force));
            double* slope = plain + all;
            for (int i = 0; i < s.width[axis]; i++) {
                const double x = i * dx - centre;
                plain[i] = scale * std::exp(-0.5 * narrowness * x * x);
                slope[i] = -narrowness * x * plain[i];
            }
        }
    }
}

/** Call visit(slab, offset) for the slabs within reach of a particle, in the order of the slabs. */
template <class Visit>
void GridStencils::forSlabs(int p, const Visit& visit) const {
    const Stencil& s = stencils[p];
    // A slab has several parts of a stencil only if the stencil is as long as the box.
    const int numSlabs = slabsOf(shape), numPlanes = shape.size[0], end = s.first[0] + s.width[0];
    const auto visitFrom = [&](int firstSlab, int lastSlab) {
        for (int slab = firstSlab; slab <= lastSlab; slab++)
            for (int away = 0; slabWidth * slab + away < end; away += numPlanes) {
                const int offset = slabWidth * slab + away - s.first[0];
                if (offset + planesOf(slab) > 0) visit(slab, offset);
            }
    };
    const int wrapped = end - numPlanes;
    if (wrapped <= 0 || wrapped > s.first[0]) {
        visitFrom(wrapped > 0 ? 0 : s.first[0] / slabWidth,
                  wrapped > 0 ? numSlabs - 1 : (end - 1) / slabWidth);
        return;
    }
    const int lastOfWrapped = (wrapped - 1) / slabWidth, firstOfOthers = s.first[0] / slabWidth;
    visitFrom(0, lastOfWrapped);
    visitFrom(std::max(lastOfWrapped + 1, firstOfOthers), numSlabs - 1);
}

/**
 * Sort the slices by slabs, and in each slab by tiles of rows and by nodes, so that neighbours
 * follow one another.
 */
void GridStencils::sortSlices() {
    byRows.resize(stencils.size());
    for (size_t p = 0; p < stencils.size(); p++) byRows[p] = p;
    std::sort(byRows.begin(), byRows.end(), [&](int p, int q) {
        const Stencil &a = stencils[p], &b = stencils[q];
        if (a.first[1] / rowsOfTile != b.first[1] / rowsOfTile) return a.first[1] < b.first[1];
        if (a.first[2] != b.first[2]) return a.first[2] < b.first[2];
        return p < q;
    });
    const int numSlabs = slabsOf(shape);
    slabs.assign(numSlabs + 1, 0);
    firstSlice.resize(stencils.size() + 1);
    firstSlice[0] = 0;
    for (size_t p = 0; p < stencils.size(); p++) {
        int count = 0;
        forSlabs(p, [&](int slab, int) {
            slabs[slab + 1]++;
            count++;
        });
        firstSlice[p + 1] = firstSlice[p] + count;
    }
    for (int slab = 0; slab < numSlabs; slab++) slabs[slab + 1] += slabs[slab];
    slices.resize(slabs[numSlabs]);
    sliceNumbers.resize(slabs[numSlabs]);
    nextOfSlab.assign(slabs.begin(), slabs.end() - 1);
    for (const int p : byRows) {
        int next = firstSlice[p];
        forSlabs(p, [&](int slab, int offset) {
            const int at = nextOfSlab[slab]++;
            slices[at] = {p, offset, 0};
            sliceNumbers[next++] = at;
        });
    }
    ranges.clear();
    for (int slab = 0; slab < numSlabs; slab++)
        for (int at = slabs[slab]; at < slabs[slab + 1]; at++) cutBall(slices[at], planesOf(slab));
}

/** Find the rows of the ball in the slice's plane nearest to the anchor. */
void GridStencils::cutBall(Slice& slice, int planes) {
    const Stencil& s = stencils[slice.particle];
    const double dx = shape.spacing(0);
    const double begin = std::max(0, slice.offset) * dx - s.anchor[0],
                 end = (std::min(s.width[0], slice.offset + planes) - 1) * dx - s.anchor[0];
    // If the slice has planes on both sides of the anchor, take the nearest plane to be at the
    // anchor.
    double x = begin > 0 ? begin : end < 0 ? end : 0;
    slice.rows = ranges.size();
    for (int j = 0; j < s.width[1]; j++) {
        const double y = j * shape.spacing(1) - s.anchor[1];
        ranges.push_back(
            within(s.cutoff * s.cutoff - x * x - y * y, s.anchor[2], shape.spacing(2), s.width[2]));
    }
}

}  // namespace RigidHIPlugin
