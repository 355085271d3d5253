#ifndef RIGIDHI_GRID_CHANNELS_H_
#define RIGIDHI_GRID_CHANNELS_H_

#include <functional>

#include "linearalgebra/AlignedArray.h"
#include "mobility/models/forcecoupling/GridStencils.h"

namespace RigidHIPlugin {

/**
 * A number for each mode of a grid. Except for the Gaussian of triclinic boxes it depends on the
 * wave number alone. It is 0 for excluded modes: k = 0, the Nyquist planes and, in triclinic boxes,
 * waves shorter than GridShape::longestWave(). If edges are along the axes, modes with the same
 * |ky| and kz share a column along x.
 */
class GridFactors {
public:
    /**
     * @param factor  a function of the wave number and of the length of k' (GridSkew), on which the
     *     Gaussian of points depends; called once for all wave vectors that differ only by signs
     */
    GridFactors(const GridShape& shape, const std::function<double(double, double)>& factor);
    /**
     * The factors of the modes (x, y, z), x = 0 ... size[0] - 1. Each number appears twice, for
     * complex columns. Zeros pad the column.
     */
    const double* column(int y, int z, double) const { return exact.data() + place(y, z); }
    const float* column(int y, int z, float) const { return single.data() + place(y, z); }
    const GridShape& getShape() const { return shape; }

private:
    size_t place(int y, int z) const {
        const int row = isSkewed ? y : std::min(y, shape.size[1] - y);
        return ((size_t)row * numModes + z) * columnNumbers;
    }
    const GridShape shape;
    const bool isSkewed;
    const size_t columnNumbers;
    const int numModes;
    AlignedArray exact;
    AlignedArrayOf<float> single;
};

/**
 * Particles whose forces, or torques, share one envelope of any isotropic shape. The particles are
 * points that spread a Gaussian, and each mode has a factor. Averages use the same Gaussian and
 * factors.
 *
 * Torques act on the fluid as half of their curl, and the average is half of the curl of the flow.
 */
struct GridChannel {
    const GridStencils*
        stencils;  // for particles without torque: three numbers each, either forces or torques
    const GridFactors* factors;  // for each mode: the envelope over the Gaussian, times the square
                                 // root of the mode's weight, over k
    bool ofTorques;
    /**
     * a^2/6 of the particles minus half of the Gaussian's variance, nm^2: the average of a flow
     * over a sphere minus that over the Gaussian, over the Laplacian of the flow. For GridWalls.
     */
    double faxen = 0;
    /**
     * Whether particles have dipoles Q instead of forces: nine numbers each, row by row, which act
     * on the fluid as -Q times the gradient of the Gaussian. Averages are then gradients of the
     * flow, dv_a/dx_b at (3 a + b).
     */
    bool ofDipoles = false;

    int numRows() const {
        return ofDipoles ? 9 * stencils->getParticles().size() : stencils->getParticles().numRows;
    }
};

/** The number of rows of vectors of channels, one channel after the other. */
inline int rowsOf(const std::vector<GridChannel>& channels) {
    int rows = 0;
    for (const GridChannel& channel : channels) rows += channel.numRows();
    return rows;
}

}  // namespace RigidHIPlugin

#endif
