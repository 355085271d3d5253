#ifndef RIGIDHI_GRID_WALL_FIELDS_H_
#define RIGIDHI_GRID_WALL_FIELDS_H_

#include <Eigen/Core>
#include <complex>
#include <functional>
#include <vector>

#include "mobility/models/forcecoupling/GridChannels.h"
#include "mobility/models/forcecoupling/GridPlanes.h"

namespace RigidHIPlugin {

/**
 * Turns a random field of waves on a grid into that of a fluid beside walls, where waves are a part
 * H of the fluid's modes and pairs of particles the rest.
 *
 * Equation:  S = S_X + S_Y is the response of the velocities on two planes (PlaneConditions) to
 *            forces there, from the rest of the modes (X) and from the modes of the grid (Y). The
 *            velocities of the modes X on the planes are b_X, of covariance S_X. Conditional on
 *            b_X, the flow X has the mean U_X 1/S_X b_X and the covariance N' = N - U_X 1/S_X
 *            U_X^+, with U_X the flow of forces on the planes, and N the matrix of pairs. So
 *                v = x' + U_X l + y + U 1/S (w - b_X - b_Y),  l = 1/S_X b_X,  cov x' = N',
 *            with y the field on the grid, b_Y its velocities on the planes, and w with the law T
 *            of velocities there. v has the covariance of the fluid between the planes, the sum of
 *            two covariances: N', and that of v - x'. This class provides v - x', in which U_X = U
 *            - U_Y: the field y - U_Y l on the grid, and U (l + 1/S (w - b_X - b_Y)), which
 *            GridWalls adds.
 * Numbers:   With L L^T = S_X, l = L^-T n for random numbers n.
 *
 * Wave vectors along the planes have 6 complex unknowns, as in GridPlanes. k = 0 is left to the
 * caller (UniformField).
 */
class GridWallFields {
public:
    static constexpr int numPlanes = 2, numUnknowns = 3 * numPlanes;
    /** The number of sets of numbers from ModeNoise::fillPlane(): those of l, and those of w. */
    static constexpr int numSets = 2 * numPlanes;
    using PartOfMode = std::function<double(double)>;
    /**
     * The flow between the planes from forces on the planes: the coefficients of four functions for
     * velocities normal to the planes, and of two functions along t, for forces in the order of
     * PlaneConditions::Matrices.
     */
    struct Flows {
        Eigen::Matrix4d across;
        Eigen::Matrix2d alongT;
    };
    /**
     * @param part     H of a wave number
     * @param longest  the wave number along the planes from which on the planes have no forces
     * @param flows    the Flows for a wave number along the planes
     */
    GridWallFields(const PlaneConditions& conditions, const GridShape& shape,
                   const PartOfMode& part, double longest,
                   const std::function<Flows(double)>& flows);
    /** The root of H over k, for each mode. */
    const GridFactors& getFactors() const { return factors; }
    const std::vector<GridPlanes::Profile>& getProfiles() const { return profiles; }
    const PlaneConditions& getConditions() const { return conditions; }
    double getPeriod() const { return shape.edge[2]; }
    double scaleOfNumbers(double viscosity) const {
        return std::sqrt(shape.edge[2] / (viscosity * shape.numNodes()));
    }
    /**
     * The forces l, and the coefficients of flows that GridWalls adds.
     *
     * @param velocities  b_Y
     * @param numbers     random numbers, of numSets sets
     * @param scale       of the numbers
     */
    void respond(int x, int y, const std::complex<double>* velocities,
                 const std::complex<double>* numbers, double scale, std::complex<double>* near,
                 std::complex<double> (&across)[4], std::complex<double> (&alongT)[2]) const;
    /** Replace velocities of the modes X by the forces 1/S_X times these velocities. */
    void respondToNear(int x, int y, std::complex<double>* velocities) const;
    /** Bytes of the matrices, and of the factors of modes in both precisions. */
    static double memory(const GridShape& shape) {
        return 8.0 * (OfLaw + 1) * numbersOfMatrix * (shape.size[0] / 2 + 1) *
                   (shape.size[1] / 2 + 1) +
               6.0 * shape.numNodes();
    }

private:
    enum Kind { Near, OfNumbers, OfVelocities, OfLaw };
    static constexpr int numbersOfMatrix = 20;
    const double* matrix(int x, int y, Kind kind) const {
        return &matrices[(((size_t)std::min(y, shape.size[1] - y) * numX +
                           std::min(x, shape.size[0] - x)) *
                              numKinds +
                          kind) *
                         numbersOfMatrix];
    }
    void store(int x, int y, Kind kind, const PlaneConditions::Matrices& from);
    /** A wave vector's unit vector, and numbers along l, t and z. */
    struct Turned {
        std::complex<double> lz[4], t[2];
    };
    Turned turned(int x, int y, const std::complex<double>* u) const;
    void turnBack(int x, int y, const Turned& from, std::complex<double>* u) const;
    static void add(const double* m, const Turned& from, double factor, Turned& to);

    const PlaneConditions conditions;
    const GridShape shape;
    const int numX, numKinds;
    const std::vector<GridPlanes::Profile> profiles;
    const GridFactors factors;
    std::vector<double> matrices;
};

}  // namespace RigidHIPlugin

#endif
