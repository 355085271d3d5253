#include "mobility/models/forcecoupling/GridStencils.h"

#include "mobility/models/forcecoupling/Envelopes.h"

using OpenMM::Vec3;

namespace RigidHIPlugin {

GridStencils::GridStencils(const HydrodynamicParticles& particles, const GridResolution& resolution)
    : particles(particles), resolution(resolution), stencils(particles.size()) {}

void GridStencils::moveTo(const GridShape& newShape, const std::vector<Vec3>& positions, bool keepAnchors) {
    layOut(newShape);
    const bool hasNone = anchors.empty();
    bool moved = hasNone;
    anchors.resize(positions.size());
    for (int p = 0; p < particles.size(); p++) {
        if (!keepAnchors || hasNone || !isNear(positions[p] - anchors[p])) {
            anchor(p, positions[p]);
            moved = true;
        }
        weigh(p, positions[p] - anchors[p]);
    }
    if (moved) sortSlices();
}

bool GridStencils::isNear(const Vec3& offset) const {
    // Farther away the ball about the anchor would leave out nodes that the tolerance wants.
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
            // Every node closer than the cutoff, wherever the anchor is between two nodes.
            s.width[axis] = 2 * (int)std::ceil(s.cutoff / shape.spacing(axis));
            if (axis == 2) s.width[axis] = padded(s.width[axis] + padding - 1);
            largest[axis] = std::max(largest[axis], s.width[axis]);
            numWeights += (size_t)kinds(p) * s.width[axis];
        }
    }
    weights.resize(numWeights);
}

void GridStencils::anchor(int p, const Vec3& position) {
    Stencil& s = stencils[p];
    anchors[p] = position;
    for (int axis = 0; axis < 3; axis++) {
        const double dx = shape.spacing(axis), L = shape.edge[axis];
        const double inBox = position[axis] - L * std::floor(position[axis] / L);
        int first = (int)std::floor(inBox / dx) - (int)std::ceil(s.cutoff / dx) + 1;
        s.first[axis] = first % shape.size[axis];
        if (s.first[axis] < 0) s.first[axis] += shape.size[axis];
        if (axis == 2) {
            first -= s.first[axis] % padding;
            s.first[axis] -= s.first[axis] % padding;
        }
        s.anchor[axis] = inBox - first * dx;
    }
}

void GridStencils::weigh(int p, const Vec3& offset) {
    const Stencil& s = stencils[p];
    const int all = s.width[0] + s.width[1] + s.width[2];
    double* w = &weights[s.weights];
    for (int axis = 0; axis < 3; w += s.width[axis++]) {
        const double dx = shape.spacing(axis), centre = s.anchor[axis] + offset[axis];
        for (int torque = 0; torque < kinds(p) / 2; torque++) {
            const double width =
                torque ? torqueEnvelopeWidth(particles.radii[p]) : forceEnvelopeWidth(particles.radii[p]);
            const double scale = std::sqrt(dx) / (std::sqrt(2 * M_PI) * width);
            double *plain = w + 2 * torque * all, *slope = plain + all;
            for (int i = 0; i < s.width[axis]; i++) {
                const double x = i * dx - centre;
                plain[i] = scale * std::exp(-x * x / (2 * width * width));
                slope[i] = -x / (width * width) * plain[i];
            }
        }
    }
}

/** By planes, and in each by rows, so that neighbours follow each other (counting sorts). */
void GridStencils::sortSlices() {
    const int numPlanes = shape.size[0];
    planes.assign(numPlanes + 1, 0);
    firstSlice.resize(stencils.size());
    int number = 0;
    for (size_t p = 0; p < stencils.size(); p++) {
        firstSlice[p] = number;
        number += stencils[p].width[0];
        for (int i = 0; i < stencils[p].width[0]; i++) planes[(stencils[p].first[0] + i) % numPlanes + 1]++;
    }
    for (int x = 0; x < numPlanes; x++) planes[x + 1] += planes[x];
    slices.resize(number);
    sliceNumbers.resize(number);
    byRows.resize(stencils.size());
    nextOfPlane.assign(shape.size[1] + 1, 0);
    for (const Stencil& s : stencils) nextOfPlane[s.first[1] + 1]++;
    for (int y = 0; y < shape.size[1]; y++) nextOfPlane[y + 1] += nextOfPlane[y];
    for (size_t p = 0; p < stencils.size(); p++) byRows[nextOfPlane[stencils[p].first[1]]++] = p;
    nextOfPlane.assign(planes.begin(), planes.end() - 1);
    for (const int p : byRows)
        for (int i = 0; i < stencils[p].width[0]; i++) {
            const int at = nextOfPlane[(stencils[p].first[0] + i) % numPlanes]++;
            slices[at] = {p, i};
            sliceNumbers[firstSlice[p] + i] = at;
        }
}

}  // namespace RigidHIPlugin
