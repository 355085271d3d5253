#ifndef RIGIDHI_BODY_MOBILITY_H_
#define RIGIDHI_BODY_MOBILITY_H_

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "mobility/RandomField.h"
#include "rigid/BodiesAt.h"
#include "rigid/ErrorBudget.h"
#include "rigid/SlipSpace.h"

namespace RigidHIPlugin {

/**
 * The mobility of one group of bodies at one configuration: all that callers ask of the fluid.
 * There are three strategies:
 *
 *   ConstantMobility  for a body alone in a uniform fluid: a tensor, known once
 *   DenseMobility     by matrices: Cholesky's factors of M and of the friction
 *   KrylovMobility    by products with M alone, to the tolerance: MultiblobSolver for U and Lanczos
 *                     for the noise
 *
 * Equation:  M lambda + s = K U, K^T lambda = F, so U = N (F + K^T M^-1 s), N = (K^T M^-1 K)^-1. U
 *            are the twists of bodies under wrenches F whose particles have the slips (random
 *            velocities) s (Westwood 2022, eqs. 33 to 36).
 * Fixed:     where components of twists are fixed (FreeMotion), lambda also holds them at rest, and
 *            N is N_c, the mobility of the free components; the twists of fixed ones are 0. Random
 *            slips and wrenches are those of all bodies, held ones too. friction() is that of all
 *            bodies.
 * Noise:     slips have the covariance M, thermalWrench() that of the friction N^-1. Both N
 *            thermalWrench() and N K^T M^-1 times slips therefore have the covariance N. The
 *            model's own random field is used where there is one (slipsOf()). thermalSlip() and
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

    explicit BodyMobility(const CoupledBodies& bodies) : bodies(bodies), slipSpace(bodies) {}
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
    const std::vector<Pose>& posesHere() const { return getPoses(); }
    /** The rotation of an element at the poses set last. */
    const Eigen::Matrix3d& getTurn(int element) const { return getTurns()[element]; }
    /** Set the errors that iterations and products may have, from the start of a step on. */
    virtual void setErrors(const ErrorBudget& errors) {}
    void setTolerance(double relative) { setErrors(ErrorBudget(relative)); }
    /** In this step no more differences are taken: iterations go to the tolerance itself. */
    virtual void endDifferences() {}
    /**
     * How the first products of iterations are made, for describeEffects(). Default, and where they
     * are sums over all pairs: empty.
     *
     * @param differenced  in a step that takes differences of iterations
     */
    virtual std::string describeProducts(bool differenced) { return {}; }
    /**
     * Whether multiplyNearby(), solve() and the thermal vectors iterate, and so are right to the
     * tolerance only.
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
    /**
     * U = N (F + K^T M^-1 s). Wrenches and slips have the same number of columns, or there are no
     * slips.
     */
    virtual void solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) = 0;
    /**
     * Keep the blob forces of a column of the last solve() for solveFromKept(). Default: nothing.
     */
    virtual void keepForces(int column) {}
    /**
     * As solve() with one column, beginning at the forces kept last, which are turned with the
     * bodies. Wrenches, slips and poses must be little different. Only iterations gain from this.
     * Default: solve().
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
     * slips = (M at `forward` - M at `backward`) lambda, for the column of getBlobForces() that
     * lambda is, which is the first one. Both poses are small displacements away from those set
     * last.
     *
     * @param noiseIsFrozen  whether the noise of a step has the same wrenches of near pairs
     * wherever the bodies are. Slips of parts then lack the wrenches that near pairs make of it.
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

    // ---- A driven flow
    /**
     * The slips of the flow at the poses set last, so that U = N (F + K^T M^-1 s). They are slips
     * of particles, or the twists of bodies without forces. Bodies without hydrodynamic particles
     * follow the flow at their origin.
     */
    void flowSlips(const DrivenFlow& flow, MatrixXd& slips);
    /**
     * The slips with which a solve gives these twists. Default: flowSlips(). Slips of parts have
     * the strain of the flow without a solve.
     */
    virtual void flowSlipsOfSolve(const DrivenFlow& flow, MatrixXd& slips) {
        flowSlips(flow, slips);
    }
    /**
     * The slips of active bodies at the poses set last, -A u of the velocities u of setBodySlip()
     * and what forces of bodies on the fluid make it do, in the form that flowSlips() has.
     */
    void activeSlips(MatrixXd& slips);
    /** Add the wrenches that bodies take from their forces on the fluid. */
    void addActiveWrenches(MatrixXd& wrenches) const {
        if (bodies.getForcesOnFluid()) bodies.getForcesOnFluid()->addWrenches(getTurns(), wrenches);
    }
    /** Add `factor` times the flow of the forces of bodies on the fluid, likewise. */
    void addFlowOfSites(const std::vector<OpenMM::Vec3>& points, double factor,
                        Velocities& velocities);
    /** The power of these forces on a flow. */
    double powerOfSites(const DrivenFlow& flow);
    /** The twists of force-free bodies in the flow. */
    void flowTwists(const DrivenFlow& flow, MatrixXd& twists);

    // ---- The flow of the fluid
    /**
     * The forces (on particles, or wrenches on bodies, as slips are) that hold bodies at these
     * twists in a driven flow (null: none).
     */
    void forcesOfTwists(const MatrixXd& twists, const DrivenFlow* flow, MatrixXd& forces);
    /** Forces f that would make the slips of thermalSlip() of the same W: M f = s. */
    virtual void forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) = 0;
    /** Forces of particles with M f = s, where slips belong to particles. */
    virtual void forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) = 0;
    /**
     * The sources of the fluid's flow when getBlobForces() gave these forces at the poses set last.
     * `flow` is the driven flow, if that solve had it. `active` says whether it had the slips of
     * active bodies.
     */
    FlowSources flowSources(const MatrixXd& forces, const DrivenFlow* flow, bool active);
    /** MobilityAt::addFlowAt() at the poses set last. */
    void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                   double factor, Velocities& velocities) {
        particlesHere().particles().addFlowAt(sources, points, factor, velocities);
    }
    /**
     * The power of sources at the poses set last on a flow: of forces on velocities of particles,
     * torques on angular velocities, stresslets on strain rates.
     */
    double powerOn(const DrivenFlow& flow, const FlowSources& sources) {
        return particlesHere().powerOn(flow, sources);
    }

    // ---- Noise
    /**
     * Draw the model's random field, for any number of poses. @return whether slips are to be taken
     * from it: there is a field, and slips belong to particles or to parts
     */
    bool drawField(const NoiseStream& noise, uint32_t purpose,
                   std::unique_ptr<RandomField>& field) const;
    /** Whether drawField() gives one. */
    bool slipsAreOfField() const {
        return (!slipSpace.areOfBodies() || slipSpace.areOfParts()) &&
               bodies.getModel().randomField();
    }
    /** Whether divergenceOf() gives the divergence of such slips: the field is one flow. */
    bool divergenceIsOfField() const {
        return slipsAreOfField() && bodies.getModel().randomField()->isLocal() &&
               !bodies.getFreeMotion().turnsWithBodies();
    }
    /** Slips of a field of the model's at the poses set last: one column of covariance M. */
    virtual void slipsOf(RandomField& field, MatrixXd& slips);
    /**
     * The divergence by the bodies' coordinates of nearestTwists() of the field's slips, at the
     * poses set last. It comes from the field's gradients where these are known. Otherwise it comes
     * from differences of six displacements of all bodies at once, since a body's twists depend on
     * its own pose only. Fixed components take no part.
     */
    double divergenceOf(RandomField& field);
    /**
     * Whether W of thermalWrench() has the rows of the bodies. If not, it has those of the
     * particles.
     */
    virtual bool wrenchNoiseIsOfBodies() const { return true; }
    /** Whether W of thermalSlip() has the rows of the bodies. */
    bool slipNoiseIsOfBodies() const { return slipSpace.areOfBodies() && wrenchNoiseIsOfBodies(); }
    /**
     * Give the numbers of the noise that pairs of particles have of their own, in addition to W, to
     * all thermal vectors until the next call. Default: there is none.
     */
    virtual void drawForPairs(const NoiseStream& noise, uint32_t purpose) {}
    /** The number of random numbers of pairs since the last call. */
    virtual long long takeNumPairNumbers() { return 0; }
    /** A wrench with the covariance N^-1. */
    virtual void thermalWrench(const MatrixXd& W, MatrixXd& wrench) = 0;
    /** Slips with the covariance M. */
    virtual void thermalSlip(const MatrixXd& W, MatrixXd& slips) = 0;

    // ---- Divergence of the mobility
    /** Whether N is the same at all poses, except for the rotation of one body. */
    bool isUniform() const {
        return bodies.isAloneInUniformFluid() && !bodies.getFreeMotion().any();
    }
    /** Whether no component is free, so that N = 0. */
    bool isImmobile() const { return bodies.getFreeMotion().getNumFree() == 0; }
    /**
     * Whether div N = 0 at all poses. If so, K = 1, and slips are twists wherever the bodies are.
     */
    bool isDivergenceFree() const { return bodies.isDivergenceFree(); }
    /** div N of a body alone in a uniform fluid, lab frame: e_k x N_VW e_k, summed; no rotational
     * part. Else 0. */
    virtual Eigen::Vector3d uniformDivergence() const { return Eigen::Vector3d::Zero(); }

    // ---- The matrices
    /** N at the poses set last. Where iterations take less time, N is right to the tolerance. */
    virtual const MatrixXd& mobility() = 0;
    /** The (pseudo-)inverse of mobility(). It has no iterations. */
    virtual const MatrixXd& friction() = 0;
    /**
     * twists = N wrenches, as products for a caller's own iteration and for users. There are no
     * blob forces.
     *
     * @param accuracy  of products that no iteration is built on here
     */
    virtual void multiply(const MatrixXd& wrenches, MatrixXd& twists,
                          const Accuracy& accuracy = Accuracy()) = 0;
    /**
     * velocities = M forces of the elements' particles at the poses set last, as if each particle
     * were free. There are three rows for each particle of the System, of which those of these
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
     * @param flow  of which the slips are; null: they are of active bodies
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
    virtual const std::vector<Pose>& getPoses() const = 0;
    virtual void beginSolving() {}
    virtual void endSolving() {}
    virtual const std::vector<Eigen::Matrix3d>& getTurns() const = 0;
    /** The particles at the poses set last, and their mobility there. */
    virtual BodiesAt& particlesHere() = 0;

    const CoupledBodies& bodies;
    MobilityCosts costs;

private:
    const Placement& placementOf(const std::vector<Pose>& poses);
    void keepSpinOf(const DrivenFlow& flow, MatrixXd& slips);
    template <class Rate>
    void keepSpins(const Rate& rateOf, MatrixXd& slips);
    void addActiveSlips(MatrixXd& ofParticles);
    void placeSites();
    double divergenceByGradients(RandomField& field);
    double divergenceByDifferences(RandomField& field);

    SlipSpace slipSpace;
    const MatrixXd noSlips;
    MatrixXd slipsAtOtherEnd;
    Placement asked, placementOfSites;
    std::unique_ptr<MobilityAt> sites;  // with all particles, at the poses set last
    MatrixXd forcesOfSites, velocitiesOfSites;
    MatrixXd fieldSlips, gradients, askedTwists;
    MatrixXd slipsOfFlow, noWrenches, spinsOfFlow, slipsOfSpins;
    std::vector<Eigen::Matrix3d> askedTurns;
};

}  // namespace RigidHIPlugin

#endif
