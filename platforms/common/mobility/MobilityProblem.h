#ifndef RIGIDHI_MOBILITY_PROBLEM_H_
#define RIGIDHI_MOBILITY_PROBLEM_H_

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "mobility/BodyMobility.h"
#include "mobility/CholeskyFactor.h"
#include "mobility/Lanczos.h"

namespace RigidHIPlugin {

/**
 * The mobility problem with noise, of one group of bodies at one configuration: what schemes without momenta ask of the fluid.
 *
 * Equation:  M lambda + s = K U, K^T lambda = F, so U = N (F + K^T M^-1 s), N = (K^T M^-1 K)^-1: the twists U of bodies under wrenches F
 *            whose particles have the slips (random velocities) s (Westwood 2022, eqs. 33 to 36).
 * Noise:     thermalSlip() has the covariance M, thermalWrench() that of the friction N^-1; so both N thermalWrench() and
 *            N K^T M^-1 thermalSlip() have the covariance N. Both are differentiable functions of the configuration for given
 *            random numbers W (Cholesky factors, symmetric square roots).
 * Slips:     live on hydrodynamic particles, three rows each, six for a sphere. Where there is no M (one body with a constant tensor,
 *            own tensors, models made from friction) they live on the bodies: K = 1, M = N.
 * Dense:     Cholesky's factors of M and of the friction, once a configuration, when first needed.
 * Matrix-free: MultiblobSolver for U and Lanczos for the noise, to the tolerance. Lanczos sees M scaled by the particles' own
 *            mobilities (multiblobs: own matrices), so that neither units nor unequal radii matter.
 * A collinear body's null twist has no noise and no velocity.
 *
 * Columns of wrenches, slips and twists are cases of their own. Nothing is allocated after the first call with as many columns,
 * in the dense way.
 */
class MobilityProblem {
public:
    /** @param tolerance  relative, of the matrix-free way */
    MobilityProblem(BodyMobility& bodies, bool matrixFree, double tolerance);

    /**
     * Of the matrix-free way, relative. Exact products: as small finite differences of what iterates want them, which would magnify
     * rounding of single precision; else as MobilityAt::applyFor().
     */
    void setTolerance(double relative, bool exactProducts = false);
    /** @param nearby  the poses are a small displacement of accepted ones: MobilityModel::near() */
    void setPoses(const std::vector<Pose>& poses, bool nearby = false);
    /** Whether N is the same at all poses, but for the turn of one body. */
    bool isUniform() const { return bodies.isAloneInUniformFluid(); }
    /** Whether div N = 0 at all poses. Then K = 1, and slips are twists wherever the bodies are. */
    bool isDivergenceFree() const { return bodies.isDivergenceFree(); }
    bool isMatrixFree() const { return matrixFree; }
    /** Whether these iterate, and so are right to the tolerance only: multiplyNearby(), solve(), the thermal vectors. */
    bool productsIterate() const { return matrixFree && bodySlips && !bodies.motion.isIdentity(); }
    bool solvesIterate() const { return matrixFree && !bodies.motion.isIdentity(); }
    bool rootsIterate() const { return matrixFree; }
    int getNumRows() const { return bodies.getNumRows(); }
    bool slipsAreOfBodies() const { return bodySlips; }
    int getNumSlipRows() const { return bodySlips ? bodies.getNumRows() : bodies.getNumParticleRows(); }
    /** Rows of W for a thermal wrench: those of the bodies, or (matrix-free) of the particles. */
    bool wrenchNoiseIsOfBodies() const { return !matrixFree; }
    const HydrodynamicParticles& getParticles() const { return bodies.motion.getParticles(); }
    const std::vector<FluidElement>& getElements() const { return bodies.getElements(); }
    const BodyMobility& getBodies() const { return bodies; }

    /** U = N F */
    void solve(const Eigen::MatrixXd& wrenches, Eigen::MatrixXd& twists) { solve(wrenches, noSlips, twists); }
    /** U = N (F + K^T M^-1 s); as many columns of both, or no slips. */
    void solve(const Eigen::MatrixXd& wrenches, const Eigen::MatrixXd& slips, Eigen::MatrixXd& twists);
    /** lambda of the last solve(), with its columns. */
    void getBlobForces(Eigen::MatrixXd& lambda);
    /** A wrench with the covariance N^-1. */
    void thermalWrench(const Eigen::MatrixXd& W, Eigen::MatrixXd& wrench);
    /** Slips with the covariance M. */
    void thermalSlip(const Eigen::MatrixXd& W, Eigen::MatrixXd& slips);

    /** slips = M lambda at poses a small displacement away; the problem stays where it is. */
    void multiplyNearby(const std::vector<Pose>& poses, const Eigen::MatrixXd& lambda, Eigen::MatrixXd& slips);
    /** slips = K U, wrenches = K^T lambda at any poses, and the twists (K^T K)^-1 K^T s nearest to slips (Westwood 2022, eq. 38). */
    void rigidSlips(const std::vector<Pose>& poses, const Eigen::MatrixXd& twists, Eigen::MatrixXd& slips) const;
    void totalWrenches(const std::vector<Pose>& poses, const Eigen::MatrixXd& lambda, Eigen::MatrixXd& wrenches) const;
    void nearestTwists(const Eigen::MatrixXd& slips, Eigen::MatrixXd& twists) const;
    /** div N of a body alone in a uniform fluid, lab frame: e_k x N_VW e_k, summed; no rotational part. Else an error. */
    Eigen::Vector3d uniformDivergence() const;

    /** Square roots taken; that of a constant tensor is known once for all. */
    long long numSquareRoots = 0;

private:
    void factorise();
    void factoriseFriction();
    void applyRoot(const SpectralFunction& f, const Eigen::MatrixXd& W, Eigen::MatrixXd& result);

    BodyMobility& bodies;
    const bool matrixFree;
    double tolerance, toleranceOfProducts;
    bool bodySlips;
    bool isFactorised = false;
    CholeskyFactor M, xi;                // factors, dense; of one constant body xi in its own frame
    Eigen::MatrixXd LK;                  // L^-1 K
    Eigen::MatrixXd mobility, friction;  // before they are factorised
    Eigen::VectorXd ownScale;  // of rows, where K = 1: about the root of a particle's own friction over 6 pi viscosity
    Eigen::MatrixXd scratch, scaled, halfSlips, halfForces, lambda;
    std::vector<Eigen::MatrixXd> nearest_body;  // (K^T K)^-1 K^T of elements, body frame
    std::vector<Pose> here;
    mutable std::vector<Eigen::Matrix3d> turns;  // of poses that are asked about
    std::unique_ptr<Lanczos> lanczos;
    const Eigen::MatrixXd noSlips;
};

}  // namespace RigidHIPlugin

#endif
