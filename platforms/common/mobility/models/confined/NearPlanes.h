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
 * What planes at rest subtract from the matrix N of pairs (NearField): U_X 1/S_X U_X^+, with U_X
 * the part of pairs of the flow that forces on the planes make at particles (GridWallFields). N
 * less this is the law of the flow of pairs, given that it is 0 on the planes.
 *
 * Method:    The planes are lattices of points. Particles reach those within the reach of pairs, by
 *            the pair functions of a point and a sphere. 1/S_X belongs to wave vectors, to which
 *            Fourier transforms lead and back. Wave vectors with k = 0 are left out (UniformField).
 * Accuracy:  Waves U_X decay as exp(-ka), as those of walls do. Points are spaced so that waves
 *            that they take for others make an error below the tolerance.
 * Cost:      About 300 points for each particle within reach of a plane, which are 16 bytes each,
 *            or 24 with torques, and six transforms in two dimensions.
 *
 * Results do not depend on the number of threads.
 */
class NearPlanes {
public:
    /**
     * @param kinds   of particles
     * @param height  from the lower to the upper plane. z = 0 is in the middle
     * @param longest  the largest wave number along the planes
     */
    NearPlanes(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds,
               const EwaldSplitting& splitting, double tolerance, double height, double longest,
               const GridWallFields& fields);
    /** As NearField::moveTo(). */
    void moveTo(const std::vector<OpenMM::Vec3>& positions, bool keepAnchors, double spacing,
                const Ranges& ranges);
    /** Subtract the product from the velocities, in units of 1/(8 pi eta), for one column. */
    void subtractProduct(const double* forces, double* velocities, const Ranges& ranges);

private:
    /** The points of a row x = const of a plane that a particle reaches. */
    struct Line {
        int particle, plane, row;  // row from 0 on
        double x;                  // of the row, from the anchor's box
        double z;                  // of the plane or its image
        int first, count;          // points along y, of which the first may be beyond the box
        size_t values;             // where its values begin
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
    AlignedArray nodes[3], transformed[3];     // the lower plane is real, the upper imaginary
};

}  // namespace RigidHIPlugin

#endif
