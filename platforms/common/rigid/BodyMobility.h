#ifndef RIGIDHI_BODY_MOBILITY_H_
#define RIGIDHI_BODY_MOBILITY_H_

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "rigid/BodiesAt.h"
#include "rigid/BodyField.h"
#include "rigid/BodyFlow.h"
#include "rigid/ErrorBudget.h"
#include "rigid/SlipSpace.h"

namespace RigidHIPlugin {

/**
 * The mobility of one group of bodies at one configuration: all that callers ask of the fluid.
 * Three strategies implement it:
 *
 *   ConstantMobility  for a body alone in a uniform fluid: a tensor, computed once
 *   DenseMobility     by matrices: Cholesky's factors of M and of the friction
 *   KrylovMobility    by products with M alone, to the tolerance: MultiblobSolver for U and Lanczos
 *                     for the noise
 *
 * Equation:  M lambda + s = K U, K^T lambda = F, so U = N (F + K^T M^-1 s), N = (K^T M^-1 K)^-1. U
 *            are the twists of bodies under wrenches F whose particles have the slips (random
 *            velocities) s (Westwood 2022, eqs. 33 to 36).
 * Fixed:     where components of twists are fixed (FreeMotion), lambda also holds these components
 *            at rest, and N is N_c, the mobility of the free components; fixed components of twists
 *            are 0. Random slips, random wrenches and friction() are those of all bodies, including
 *            held ones.
 * Noise:     slips have the covariance M, thermalWrench() that of the friction N^-1. Both N
 *            thermalWrench() and N K^T M^-1 times slips therefore have the covariance N. Where the
 *            model has a random field of its own, slips come from it (slipsOf()). thermalSlip() and
 *            thermalWrench() are differentiable functions of the configuration for given random
 *            numbers W (Cholesky factors, symmetric square roots).
 * Slips:     SlipSpace says whether they belong to particles or to bodies. The null twist of a
 *            collinear body has no noise and no velocity.
 *
 * Columns of wrenches, slips and twists are independent. Nothing is allocated after the first call
 * with as many columns, except by KrylovMobility. All cached results belong to one configuration.
 * Another configuration (multiplyNearby()) has its own storage.
 */
class BodyMobility {
public:
    using MatrixXd = Eigen::MatrixXd;
    enum Way { Constant, Dense, Krylov };

    explicit BodyMobility(const CoupledBodies& bodies)
        : bodies(bodies), slipSpace(bodies), bodyFlow(*this), bodyField(*this) {}
    virtual ~BodyMobility() {}
    virtual Way getWay() const = 0;
    const CoupledBodies& getBodies() const { return bodies; }
    const SlipSpace& getSlipSpace() const { return slipSpace; }

    // ---- Configuration and tolerance
    /**
     * @param nearby  the poses are a small displacement from accepted ones: MobilityModel::near()
     * @throws OpenMMException  as BodiesAt::setPoses()
     */
    virtual void setPoses(const std::vector<Pose>& poses, bool nearby = false) = 0;
    virtual const std::vector<Pose>& getPoses() const = 0;
    /** The rotation of an element at the poses set last. */
    const Eigen::Matrix3d& getTurn(int element) const { return getTurns()[element]; }
    /** Set the errors that iterations and products may have, from the start of a step on. */
    virtual void setErrors(const ErrorBudget& errors) {}
    void setTolerance(double relative) { setErrors(ErrorBudget(relative)); }
    /**
     * Say that this step takes no more differences: from now on iterations go to the tolerance
     * itself.
     */
    virtual void endDifferences() {}
    /**
     * How the first products of iterations with these errors are made, for describeEffects(). Empty
     * by default, and where products are sums over all pairs.
     *
     * @param withRoots  whether the step takes roots of the mobility of blobs
     */
    virtual std::string describeProducts(const ErrorBudget& errors, bool withRoots = true) {
        return {};
    }
    /**
     * Whether multiplyNearby(), solve() and the thermal vectors iterate. Results of iterations are
     * right to the tolerance only.
     */
    virtual bool productsIterate() const { return false; }
    virtual bool solvesIterate() const { return false; }
    virtual bool rootsIterate() const { return false; }
    /** MobilityTraits::mayObject, objection() and acceptsNearby() for bodies at any poses. */
    bool mayObject() const { return bodies.hasModel() && bodies.getModel().getTraits().mayObject; }
    std::string objection(const std::vector<Pose>& poses);
    bool acceptsNearby(const std::vector<Pose>& poses);

    // ---- The mobility problem
    /** U = N F */
    void solve(const MatrixXd& wrenches, MatrixXd& twists) { solve(wrenches, noSlips, twists); }
    /** U = N (F + K^T M^-1 s). Slips have the same number of columns as wrenches, or are empty. */
    virtual void solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) = 0;
    /**
     * Keep the blob forces of a column of the last solve() for solveFromKept(). Default: nothing.
     */
    virtual void keepForces(int column) {}
    /**
     * As solve() with one column, but beginning at the forces kept last, turned with the bodies.
     * Wrenches, slips and poses must have changed little. Only iterations gain from this. Default:
     * solve().
     */
    virtual void solveFromKept(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
        solve(wrenches, slips, twists);
    }
    /** lambda of the last solve(), with its columns. */
    virtual void getBlobForces(MatrixXd& lambda) = 0;
    /** slips = M lambda at poses that are a small displacement away from those set last. */
    virtual void multiplyNearby(const std::vector<Pose>& poses, const MatrixXd& lambda,
                                MatrixXd& slips) = 0;
    /**
     * slips = (M at `forward` - M at `backward`) lambda, where lambda is the first column of
     * getBlobForces(). Both poses are small displacements away from those set last.
     *
     * @param noiseIsFrozen  whether the wrenches of near pairs in a step's noise stay the same
     *     wherever the bodies are. If so, slips of parts lack the wrenches of near pairs.
     */
    virtual void differenceNearby(const std::vector<Pose>& forward,
                                  const std::vector<Pose>& backward, const MatrixXd& lambda,
                                  bool noiseIsFrozen, MatrixXd& slips) {
        multiplyNearby(forward, lambda, slips);
        multiplyNearby(backward, lambda, slipsAtOtherEnd);
        slips -= slipsAtOtherEnd;
    }
    /**
     * slips = K U; wrenches = K^T lambda at any poses; and the twists nearest to slips: see
     * SlipSpace.
     */
    void rigidSlips(const std::vector<Pose>& poses, const MatrixXd& twists, MatrixXd& slips) {
        slipSpace.rigidSlips(poses, twists, slips);
    }
    void totalWrenches(const std::vector<Pose>& poses, const MatrixXd& lambda, MatrixXd& wrenches) {
        slipSpace.totalWrenches(poses, lambda, wrenches);
    }
    void nearestTwists(const MatrixXd& slips, MatrixXd& twists) const {
        slipSpace.nearestTwists(getTurns(), slips, twists);
        bodies.getFreeMotion().removeFixed(getTurns(), twists);
    }

    // ---- The flow of the fluid, and noise from the model's random field
    BodyFlow& flow() { return bodyFlow; }
    BodyField& field() { return bodyField; }
    const BodyField& field() const { return bodyField; }
    /**
     * The slips with which a solve gives the same twists as with BodyFlow::slipsOf(). Default:
     * those. Slips of parts express the strain of the flow without a solve.
     */
    virtual void flowSlipsOfSolve(const DrivenFlow& flow, MatrixXd& slips) {
        bodyFlow.slipsOf(flow, slips);
    }
    /** Forces f with M f = s, where s are the slips of thermalSlip() of the same W. */
    virtual void forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) = 0;
    /** Forces of particles with M f = s, where slips belong to particles. */
    virtual void forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) = 0;

    // ---- Noise
    /** Slips of the model's random field at the poses set last: one column of covariance M. */
    virtual void slipsOf(RandomField& field, MatrixXd& slips);
    /**
     * Whether W of thermalWrench() has the rows of the bodies. If not, it has those of the
     * particles.
     */
    virtual bool wrenchNoiseIsOfBodies() const { return true; }
    /** Whether W of thermalSlip() has the rows of the bodies. */
    bool slipNoiseIsOfBodies() const { return slipSpace.areOfBodies() && wrenchNoiseIsOfBodies(); }
    /**
     * Set the random numbers of the noise that pairs of particles have in addition to W; all
     * thermal vectors use these until the next call. Default: pairs have no noise.
     */
    virtual void drawForPairs(const NoiseStream& noise, uint32_t purpose) {}
    /** The number of random numbers drawn for pairs since the last call. */
    virtual long long takeNumPairNumbers() { return 0; }
    /** A wrench with the covariance N^-1. */
    virtual void thermalWrench(const MatrixXd& W, MatrixXd& wrench) = 0;
    /** Slips with the covariance M. */
    virtual void thermalSlip(const MatrixXd& W, MatrixXd& slips) = 0;

    // ---- Divergence of the mobility
    /**
     * div N of a body alone in a uniform fluid, lab frame: the sum over k of e_k x N_VW e_k,
     * without rotational part. 0 for other bodies.
     */
    virtual Eigen::Vector3d uniformDivergence() const { return Eigen::Vector3d::Zero(); }

    // ---- The matrices
    /** N at the poses set last. Where iterations take less time, N is right to the tolerance. */
    virtual const MatrixXd& mobility() = 0;
    /** The (pseudo-)inverse of mobility(), computed without iterations. */
    virtual const MatrixXd& friction() = 0;
    /**
     * twists = N wrenches: products for a caller's own iteration and for users. Afterwards no blob
     * forces are known.
     *
     * @param accuracy  of products; where this method iterates itself, the error budget decides
     *     instead
     */
    virtual void multiply(const MatrixXd& wrenches, MatrixXd& twists,
                          const Accuracy& accuracy = Accuracy()) = 0;
    /**
     * velocities = M forces of the elements' particles at the poses set last, as if each particle
     * were free. Both vectors have three rows for each particle of the System; the rows of these
     * particles are read and written. Spheres take no torque, and own tensors have no effect.
     */
    void applyToParticles(const Eigen::VectorXd& forces, Eigen::VectorXd& velocities);

    const MobilityCosts& getCosts() const { return costs; }

    /**
     * While this object lives, the thread is in a Krylov method whose products may be on a grid.
     * Its time without these products counts as the solver's. Objects may be nested.
     */
    class Solving {
    public:
        explicit Solving(BodyMobility& mobility) : mobility(mobility) { mobility.beginSolving(); }
        ~Solving() { mobility.endSolving(); }
        Solving(const Solving&) = delete;

    private:
        BodyMobility& mobility;
    };

protected:
    /**
     * The twists of force-free bodies whose particles have these slips, at the poses set last. Own
     * tensors have no effect. Default: by matrices.
     *
     * @param flow  the flow that has these slips; null: the slips are those of active bodies
     */
    virtual void forceFreeTwists(const DrivenFlow* flow, const MatrixXd& slips, MatrixXd& twists) {
        particlesHere().forceFreeTwists(slips, bodies.getNullTwists(), twists);
    }
    /**
     * Forces of particles whose bodies have these wrenches and slips, at the poses set last. Own
     * tensors have no effect. Default: by matrices.
     */
    virtual void particleForces(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& forces) {
        particlesHere().particleForces(wrenches, slips, bodies.getNullTwists(), forces);
    }
    virtual void beginSolving() {}
    virtual void endSolving() {}
    virtual const std::vector<Eigen::Matrix3d>& getTurns() const = 0;
    /** The particles at the poses set last, and their mobility there. */
    virtual BodiesAt& particlesHere() = 0;

    const CoupledBodies& bodies;
    MobilityCosts costs;

private:
    const Placement& placementOf(const std::vector<Pose>& poses);
    friend class BodyFlow;
    friend class BodyField;

    SlipSpace slipSpace;
    BodyFlow bodyFlow;
    BodyField bodyField;
    const MatrixXd noSlips;
    MatrixXd slipsAtOtherEnd;
    Placement asked;
    std::vector<Eigen::Matrix3d> askedTurns;
};

}  // namespace RigidHIPlugin

#endif
