#ifndef RIGIDHI_MULTIBLOB_SOLVER_H_
#define RIGIDHI_MULTIBLOB_SOLVER_H_

#include <memory>
#include <vector>

#include "linearalgebra/Decompositions.h"
#include "mobility/MobilityModel.h"
#include "rigid/FluidElement.h"
#include "rigid/HeldBlock.h"
#include "rigid/SlowedSpin.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

class NullTwists;
class RigidMotion;

/**
 * The motion of rigid multiblobs under given forces and torques, without a matrix over all blobs.
 *
 * Equation:  M lambda + s = K U, K^T lambda = F. lambda are the blob forces that keep bodies rigid
 *            in spite of the slips s (random velocities of blobs); they add up to F. So U = N (F +
 *            K^T M^-1 s) (Westwood 2022, eqs. 7-10, 33-36).
 * Method:    lambda minimises lambda^T M lambda / 2 + lambda^T s under K^T lambda = F, by conjugate
 *            gradients projected onto the constraint (Gould, Hribar, Nocedal, SIAM J. Sci. Comput.
 *            23, 1376 (2001)). The preconditioner is every body's own mobility matrix in the body
 *            frame; bodies of one shape share one factor. The first guess is the solution for
 *            bodies that do not feel each other. The multipliers of the constraint are U.
 * Accuracy:  the energy norm of the error of lambda is below the tolerance times that of lambda.
 *            Every U F is therefore right to the square of the tolerance, and U to the tolerance in
 *            the norm of the friction. A solve that does not get there throws. The energy of the
 *            error is at most r^T M~^-1 r over the smallest eigenvalue of M~^-1 M, with the
 *            residual r and the bodies' own matrices M~; the iteration estimates this eigenvalue by
 *            the smallest Ritz value. With slips the scale of the error is the energy of forces and
 *            slips together, but never more than the larger of two parts (scaleWithSlips()): U in
 *            the norm of the bodies' own friction, and three times the norm of U that random slips
 *            cause (by the number of rows). Random velocities are therefore right to three
 *            tolerances. The cap is needed because the slips of many blobs have far more energy
 *            than the part of them that moves the body.
 * Precision: products have the error that the caller allows (Accuracy::error). Once the recursive
 *            residual has shrunk by about this error, it is no longer the true residual. Each time
 *            before this happens, the iteration computes the residual anew from lambda by an exact
 *            product, and goes on (van der Vorst, Ye, SIAM J. Sci. Comput. 22, 835 (2000)). With
 *            Accuracy::errorOfSinglePrecision one product is exact at a tolerance of 1e-6, and none
 *            at 5e-5 and more. If inexact products do not converge, the solver tries finer ones,
 *            and in the end exact ones.
 * Fixed:     where components of twists are fixed (FreeMotion), U has only free components, and so
 *            K^T lambda = F holds in their rows only. The blobs of held bodies resist like a porous
 *            medium, which would need many iterations. All held bodies are therefore one block of
 *            the preconditioner (HeldBlock), made once, unless they have more than mostHeldBlobs
 *            blobs. Random slips do not depend on what is held: their roots use M~ of each body.
 * Cost:      an iteration has one product with M and one solve with each body's own matrix.
 */
class MultiblobSolver {
public:
    /** @param model  gives the mobility of a body by itself, for the preconditioner */
    MultiblobSolver(const RigidMotion& motion, const NullTwists& nullTwists,
                    const MobilityModel& model);
    /**
     * Set the poses of the bodies, and their rotations. Of free bodies only the rotations matter;
     * the rotation of a free particle is not used.
     */
    void setPoses(const std::vector<Pose>& poses, const std::vector<Eigen::Matrix3d>& turns);
    /**
     * Up to this number of held blobs are one block of the preconditioner. Reading a larger block
     * takes as long as the iterations that it saves. Compared with steps without the block, steps
     * with it took 0.6 to 0.8 of the time where 756 of 768 blobs were held, 0.8 to 1.3 with 1008 of
     * 1050, and 0.9 to 1.4 with 1470 of 1512.
     */
    static constexpr int mostHeldBlobs = 1000;
    /**
     * The tolerance that the user has set, for messages of solves that aim at a part of it. 0: not
     * known.
     */
    double wantedTolerance = 0;
    /**
     * twists = N wrenches, each column independent.
     * @return iterations
     * @throws OpenMMException with the tolerance that was reached, if this is not the wanted one
     */
    int apply(MobilityAt& blobs, const Eigen::MatrixXd& wrenches, double tolerance,
              Eigen::MatrixXd& twists);
    /**
     * twists = N (wrenches + K^T M^-1 slips), with slips of the blobs (lab frame; as many columns;
     * empty: none).
     *
     * @param error          of products in iterations, as in Accuracy::error; 0: exact
     *     ones only
     * @param fromGuess      begin at the solution that keepGuess() has kept, corrected by the
     *     bodies' own response to the changes. This is for one column, and for wrenches and slips
     *     that have changed little.
     */
    int solve(MobilityAt& blobs, const Eigen::MatrixXd& wrenches, const Eigen::MatrixXd& slips,
              double tolerance, double error, Eigen::MatrixXd& twists, bool fromGuess = false);
    /** The largest error of products with which a solve to this tolerance needs no exact ones. */
    double errorFor(double tolerance) const;
    /**
     * The ratio of two relative errors of products: the error of multiplyScaled() with random
     * vectors, over that of a product with random forces.
     */
    double getAmplification() const { return amplification; }
    /** Keep a column of the last solve. It turns with the bodies. */
    void keepGuess(int column);
    /** Products with one vector of the last solve, exact and inexact. */
    int getNumProducts() const { return numProducts; }
    /** How many of them were exact. */
    int getNumExactProducts() const { return numExactProducts; }
    /** The blob forces of the last solve, lab frame. */
    void getBlobForces(Eigen::MatrixXd& lambda_lab) const;

    // With M~ = L L^T in the body frame and T the turn to the lab frame, the well-conditioned S =
    // L^-1 T^T M T L^-T stands for M. Then s = T L S^(1/2) W has the covariance M, and K^T T L^-T
    // S^(-1/2) W that of the friction K^T M^-1 K.
    /** y = S x; `error` as in Accuracy::error. */
    void multiplyScaled(MobilityAt& blobs, double error, const Eigen::MatrixXd& x,
                        Eigen::MatrixXd& y);
    /** slips = T L x */
    void slipsFromScaled(const Eigen::MatrixXd& x, Eigen::MatrixXd& slips_lab);
    /** The inverse, x = L^-1 T^T slips; and forces = T L^-T x. */
    void scaledFromSlips(const Eigen::MatrixXd& slips_lab, Eigen::MatrixXd& x);
    void forcesFromScaled(const Eigen::MatrixXd& x, Eigen::MatrixXd& forces_lab);
    /** L^-1 T^T times the slips with which the element moves along the axes of the lab frame. */
    Eigen::MatrixXd scaledTranslations(int element) const {
        return shapes[element]->scaledK.leftCols<3>() * turns[element].transpose();
    }
    /**
     * The parts of x that move bodies: the coefficients of x in an orthonormal basis of the columns
     * of L^-1 K of each body. Their norm is that of the bodies' velocities caused by slips T L x,
     * or of the wrenches K^T T L^-T x, scaled by the bodies' own frictions.
     */
    void rigidParts(const Eigen::MatrixXd& x, Eigen::MatrixXd& parts);
    /** wrenches = K^T T L^-T x */
    void wrenchesFromScaled(const Eigen::MatrixXd& x, Eigen::MatrixXd& wrenches_lab);
    // Bodies that do not feel each other, with N~ = (K^T M~^-1 K)^-1.
    /** twists = N~ K^T T L^-T x: those that slips T L x cause. */
    void ownTwists(const Eigen::MatrixXd& x, Eigen::MatrixXd& twists_lab);
    /** The part of x that moves bodies: rigid = L^-1 T^T K U with these twists U. */
    void ownRigid(const Eigen::MatrixXd& x, Eigen::MatrixXd& rigid);
    /** x = L^-1 T^T K N~ wrenches, so that T L^-T x are the forces of blobs under wrenches. */
    void ownForces(const Eigen::MatrixXd& wrenches_lab, Eigen::MatrixXd& x);

private:
    class Attempt;
    /** What elements of one shape share, in the body frame. */
    struct Shape {
        std::vector<Eigen::Vector3d> sites;
        std::vector<double> radii;
        SlowedSpin spin;
        bool isFree, isSphere;
        unsigned fixed = 0;      // FluidElement::fixed
        bool isHeld = false;     // wholly fixed: nothing moves it
        bool isInBlock = false;  // HeldBlock preconditions it
        int numBlobRows = 0, numBodyRows = 0;
        Eigen::LLT<Eigen::MatrixXd> M;
        Eigen::MatrixXd K, MinvK, friction, N;
        Eigen::MatrixXd rigid;    // an orthonormal basis of the columns of L^-1 K; zeros fill it up
        Eigen::MatrixXd scaledK;  // L^-1 K
    };
    /**
     * The elements of one shape. The solver treats all of them at once, as columns of one matrix: a
     * solve with many columns takes a third of the time of many solves with one column.
     */
    struct Family {
        std::shared_ptr<const Shape> shape;
        std::vector<int> elements;
    };
    enum Rows { OfBlobs, OfBodies };
    int firstRow(Rows kind, int element) const;
    /** Put the elements' rows side by side, for each element all columns; and the inverse. */
    void gather(Rows kind, const Family& family, const Eigen::MatrixXd& from,
                Eigen::MatrixXd& to) const;
    void scatter(Rows kind, const Family& family, const Eigen::MatrixXd& from,
                 Eigen::MatrixXd& to) const;
    /** to = act(shape, from) for the blobs of each family; act changes its matrix in place. */
    template <class Act>
    void actOnBlobs(const Eigen::MatrixXd& from, Eigen::MatrixXd& to, const Act& act);
    /**
     * The rows of bodies from those of their blobs: act(shape, from, to). Held bodies get zeros
     * unless `alsoHeld`.
     */
    template <class Act>
    void reduceToBodies(const Eigen::MatrixXd& from, Eigen::MatrixXd& to, bool alsoHeld,
                        const Act& act);
    void turn(Rows kind, bool toBody, const Eigen::MatrixXd& from, Eigen::MatrixXd& to) const;
    void project();
    void scaledToForces(const Eigen::MatrixXd& x, Eigen::MatrixXd& forces_body);
    void slipsToScaled(const Eigen::MatrixXd& slips_body, Eigen::MatrixXd& x);
    void multiply(MobilityAt& blobs, double error, const Eigen::MatrixXd& lambda_body,
                  Eigen::MatrixXd& result_body);
    void begin(const Eigen::MatrixXd& wrenches_body, const Eigen::MatrixXd& slips_body,
               Eigen::MatrixXd& lambda_body);
    void beginFromGuess(const Eigen::MatrixXd& wrenches_body, const Eigen::MatrixXd& slips_body);
    void findEnergyOfTwists(Eigen::VectorXd& energy);
    void findEnergyOfSlips(const Eigen::MatrixXd& slips_body, Eigen::VectorXd& energy);
    void findRounding(const Eigen::MatrixXd& wrenches, Eigen::VectorXd& energy);

    std::shared_ptr<Shape> makeShape(const FluidElement& element, const Eigen::MatrixXd& M,
                                     const Eigen::MatrixXd& K, const Eigen::VectorXd& nullTwist);
    void restrict(const std::vector<Eigen::Matrix3d>& ofBodies);

    const RigidMotion& motion;
    const NullTwists& nullTwists;
    const MobilityModel& model;
    const bool hasSinglePrecision;
    std::unique_ptr<HeldBlock> heldBlock;  // null: own matrices precondition held blobs
    /** Elements with some fixed components: each has a shape of its own. */
    std::vector<std::pair<int, std::shared_ptr<Shape>>> restricted;
    int numFreeRows = 0;
    int numRows = 0, numBlobRowsTotal = 0;
    std::vector<std::shared_ptr<const Shape>> shapes;
    std::vector<Family> families;
    std::vector<Eigen::Matrix3d> turns;  // body to lab
    double growth = 1;                   // of errors of products in the energy norm, at most
    double amplification = 1;            // see getAmplification()
    int numProducts = 0, numExactProducts = 0;
    Eigen::MatrixXd lambdaOfGuess, slipsOfGuess,
        wrenchesOfGuess;  // one column, in the frames of the bodies
    Eigen::MatrixXd lambda, residual, direction, preconditioned, product, twists_body,
        wrenches_body, slips_body, scaled, lab, labProduct, gathered, gatheredTwists,
        gatheredForces, ofBodies;
};

}  // namespace RigidHIPlugin

#endif
