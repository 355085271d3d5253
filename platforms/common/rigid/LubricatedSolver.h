#ifndef RIGIDHI_LUBRICATED_SOLVER_H_
#define RIGIDHI_LUBRICATED_SOLVER_H_

#include <Eigen/Core>
#include <vector>

#include "linearalgebra/Gmres.h"
#include "mobility/NearAndFar.h"
#include "rigid/MultiblobSolver.h"

namespace RigidHIPlugin {

class RigidMotion;

/**
 * The motion of spheres with lubrication beside multiblobs and free particles, without a matrix
 * over all of them.
 *
 * Equation:  M lambda + s = K U, K^T (lambda + Delta K U) = F, so U = N (F + K^T M^-1 s) with N =
 *            (K^T (M^-1 + Delta) K)^-1. M and Delta are those of NearAndFar. Delta has rows of
 *            single spheres only.
 * Method:    one GMRES over all particles. K of a sphere is invertible, so that lambda of spheres
 *            follows from their velocities V: lambda = K^-T F - Delta V. The iteration finds V of
 *            spheres and free particles, and x = L^T lambda of multiblobs (the scaled forces of
 *            MultiblobSolver). The part of x that acts on bodies follows from F alone. In its place
 *            the vectors of the iteration have L^-1 K U, which the rows of blobs then give without
 *            another product. NearFactor scales V.
 * Accuracy:  the error of U is within the tolerance, in the norm of the friction (Gmres,
 *            InnerErrors). It is relative to U in the norm of the bodies' own friction and Delta.
 *            With slips this scale is at least three times the norm of U that random slips of
 *            multiblobs cause, as in MultiblobSolver.
 * Cost:      one product with M for each iteration, and one more.
 * Fixed:     held bodies and particles have unknown forces and no velocity; N is that of the free
 *            components (FreeMotion). Where only some motions of a sphere are free, P projects on
 *            them: V = P z, and lambda = P (K^-T F - Delta V) - (1 - P) D (1 - P) z with the
 *            unknown z and the own friction D.
 */
class LubricatedSolver {
public:
    LubricatedSolver(const RigidMotion& motion, MultiblobSolver& multiblobs);
    /**
     * Solve for every column.
     *
     * @param parts  M and Delta at the poses of `multiblobs`
     * @param turns  rotations of the bodies
     * @param slips  of particles, as many columns as wrenches; empty: none
     * @throws OpenMMException  as Gmres::solve()
     */
    void solve(NearAndFar& parts, const std::vector<Eigen::Matrix3d>& turns,
               const Eigen::MatrixXd& wrenches, const Eigen::MatrixXd& slips, double tolerance,
               Eigen::MatrixXd& twists);
    /** lambda of the last solve. */
    const Eigen::MatrixXd& getFarForces() const { return farForces; }
    /** Products with M of the last solve, and iterations. */
    long long getNumProducts() const { return numProducts; }
    long long getNumIterations() const { return numIterations; }

private:
    /** Rows of particles of one element. */
    struct Rows {
        int first, count;
    };
    static void clear(const std::vector<Rows>& rows, Eigen::MatrixXd& x);
    /** A sphere with some free motions, and the projector on them (NearFactor::setFree()). */
    struct Restricted {
        int element, row, sphere;
    };
    void setFree(NearFactor& factor, const std::vector<Eigen::Matrix3d>& turns);
    void split(NearFactor& factor, const Eigen::MatrixXd& unknowns);
    void findForces(NearAndFar& parts);
    void toUnknowns(NearFactor& factor, const Eigen::MatrixXd& slips, Eigen::MatrixXd& unknowns);
    double leastScale(const Eigen::MatrixXd& slips);

    const RigidMotion& motion;
    MultiblobSolver& multiblobs;
    std::vector<Restricted> restricted;
    std::vector<NearFactor::Projector> free;  // empty where no sphere is restricted
    int numSpheres = 0;
    // Where the unknowns are forces (multiblobs and what is held) or velocities (others).
    std::vector<Rows> ofForces, ofVelocities;
    int numForceRows = 0,
        numFreeRows = 0;  // rows of such forces, and of the twists of their bodies
    Gmres gmres;
    long long numProducts = 0, numIterations = 0;
    Eigen::MatrixXd farForces, ofFar, rightSide, solution, scaled, ofBodies;
    // The parts of unknowns: scaled forces and motion of multiblobs, velocities of other particles;
    // and the forces that follow from them.
    Eigen::MatrixXd scaledForces, rigid, velocities, ofFixed, forces, near;
};

}  // namespace RigidHIPlugin

#endif
