#ifndef RIGIDHI_NEAR_PLANES_H_
#define RIGIDHI_NEAR_PLANES_H_

#include <array>
#include <vector>

#include "linearalgebra/AlignedArray.h"
#include "mobility/models/ewald/SplitBox.h"
#include "mobility/models/forcecoupling/FourierPlan.h"
#include "mobility/models/forcecoupling/GridWallFields.h"

namespace RigidHIPlugin {

/**
 * The matrix that planes at rest subtract from the matrix N of pairs (NearField): U_X 1/S_X U_X^+.
 * U_X is the part of pairs in the flow of forces on the planes at particles (GridWallFields). The
 * difference is the covariance of the flow of pairs, conditional on its being 0 on the planes.
 *
 * Method:    The planes are lattices of points. Particles act on the points within the reach of
 *            pairs by the pair functions of a point and a sphere. 1/S_X acts on wave vectors,
 *            between two Fourier transforms. The class leaves out wave vectors with k = 0
 *            (UniformField).
 * Accuracy:  Waves U_X decay as exp(-ka), like those of walls. The points are so dense that
 *            aliasing causes an error below the tolerance.
 * Cost:      About 300 points for each particle within reach of a plane, with 16 bytes each, or 24
 *            with torques, and six two-dimensional transforms.
 *
 * Results do not depend on the number of threads.
 */
class NearPlanes {
public:
    /**
     * @param kinds   of particles
     * @param height  distance from the lower to the upper plane. z = 0 is in the middle
     * @param longest  the largest wave number along the planes
     */
    NearPlanes(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds,
               const EwaldSplitting& splitting, double tolerance, double height, double longest,
               const GridWallFields& fields);
    /** Likewise the bytes that it needs, if all particles are next to a plane. */
    static double memory(const HydrodynamicParticles& particles,
                         const std::vector<EwaldKind>& kinds, const EwaldSplitting& splitting,
                         double tolerance, double height, double longest);
    /** As NearField::moveTo(). */
    void moveTo(const std::vector<OpenMM::Vec3>& positions, bool keepAnchors, double spacing,
                const Ranges& ranges);
    /** Subtract the product from the velocities, in units of 1/(8 pi eta), for one column. */
    void subtractProduct(const double* forces, double* velocities, const Ranges& ranges);

private:
    /** The points in a row x = const of a plane that a particle reaches. */
    struct Line {
        int particle, plane, row;  // row from 0 on
        double x;                  // of the row, from the anchor's box
        double z;                  // of the plane or its image
        int first, count;          // points along y; the first may be beyond the box
        size_t values;             // index of its first value
    };
    void findLines();
    template <int numbers>
    void findValues(int firstParticle, int endParticle);
    void spreadRow(int row, const double* forces);
    void average(int particle, double* velocities) const;
    void transform(int c, bool back);
    void respond();
    int wrapped(int i, int axis) const { return (i % size[axis] + size[axis]) % size[axis]; }

    const HydrodynamicParticles& particles;
    const double height, period, longest;
    const GridWallFields& fields;
    const NearTables tables;
    std::vector<int> kind;
    bool anyTorques = false;
    std::array<int, 2> size;
    std::array<double, 2> edge, step;
    FourierPlan<double> plans[2][2];  // along x and y, there and back
    std::vector<OpenMM::Vec3> anchors, places;
    std::vector<Line> lines;
    std::vector<int> firstOfParticle;          // among lines
    std::vector<int> linesOfRows, firstOfRow;  // lines of a row
    std::vector<double> values;                // of lines
    AlignedArray nodes[3], transformed[3];     // real part: the lower plane; imaginary part: the
                                               // upper one
};

}  // namespace RigidHIPlugin

#endif
