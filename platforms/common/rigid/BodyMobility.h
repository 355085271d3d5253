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
    /** Whether lambda are the wrenches themselves, as for spheres about their centres. */
    bool blobForcesAreWrenches() const { return slipSpace.slipsAreTwists(); }
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

    // ---- A driven flow
    /**
     * The slips of the flow at the poses set last, so that U = N (F + K^T M^-1 s). If slips belong
     * to bodies, they are the twists of force-free bodies. Bodies without hydrodynamic particles
     * follow the flow at their origin.
     */
    void flowSlips(const DrivenFlow& flow, MatrixXd& slips);
    /**
     * The slips with which a solve gives the same twists as with flowSlips(). Default: flowSlips().
     * Slips of parts express the strain of the flow without a solve.
     */
    virtual void flowSlipsOfSolve(const DrivenFlow& flow, MatrixXd& slips) {
        flowSlips(flow, slips);
    }
    /**
     * The slips of active bodies at the poses set last: -A u, with the velocities u of
     * setBodySlip(), and the flow of the forces that bodies exert on the fluid. They have the form
     * of flowSlips().
     */
    void activeSlips(MatrixXd& slips);
    /** Add the wrenches that bodies take from their forces on the fluid. */
    void addActiveWrenches(MatrixXd& wrenches) const {
        if (bodies.getForcesOnFluid()) bodies.getForcesOnFluid()->addWrenches(getTurns(), wrenches);
    }
    /**
     * Add `factor` times the flow of the forces of bodies on the fluid to the velocities at points.
     */
    void addFlowOfSites(const std::vector<OpenMM::Vec3>& points, double factor,
                        Velocities& velocities);
    /** The power of the forces of bodies on the fluid in a flow. */
    double powerOfSites(const DrivenFlow& flow);
    /** The twists of force-free bodies in the flow. */
    void flowTwists(const DrivenFlow& flow, MatrixXd& twists);

    // ---- The flow of the fluid
    /**
     * The forces that give bodies these twists in a driven flow (null: none). They are forces on
     * particles, or wrenches on bodies, as slips belong to particles or to bodies.
     */
    void forcesOfTwists(const MatrixXd& twists, const DrivenFlow* flow, MatrixXd& forces);
    /** Forces f with M f = s, where s are the slips of thermalSlip() of the same W. */
    virtual void forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) = 0;
    /** Forces of particles with M f = s, where slips belong to particles. */
    virtual void forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) = 0;
    /**
     * The sources of the fluid's flow of the solve with these getBlobForces(), at the poses set
     * last.
     *
     * @param flow    the driven flow, if the solve contained it; else null
     * @param active  whether the solve contained the slips of active bodies
     * @param accuracy  as in MobilityAt::sources()
     */
    FlowSources flowSources(const MatrixXd& forces, const DrivenFlow* flow, bool active,
                            const Accuracy& accuracy = Accuracy());
    /** MobilityAt::addFlowAt() at the poses set last. */
    void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                   double factor, Velocities& velocities) {
        particlesHere().particles().addFlowAt(sources, points, factor, velocities);
    }
    /**
     * The power of sources at the poses set last in a flow: forces times velocities of particles,
     * torques times angular velocities, stresslets times strain rates.
     */
    double powerOn(const DrivenFlow& flow, const FlowSources& sources) {
        return particlesHere().powerOn(flow, sources);
    }

    // ---- Noise
    /**
     * Draw the model's random field, for any number of poses.
     *
     * @return whether slips have to come from the field: the model has one, and slips belong to
     *     particles or to parts
     */
    bool drawField(const NoiseStream& noise, uint32_t purpose,
                   std::unique_ptr<RandomField>& field) const;
    /** Whether drawField() gives a field. */
    bool slipsAreOfField() const {
        return (!slipSpace.areOfBodies() || slipSpace.areOfParts()) &&
               bodies.getModel().randomField();
    }
    /** Whether divergenceOf() gives the divergence of such slips: the field is one flow. */
    bool divergenceIsOfField() const {
        return slipsAreOfField() && bodies.getModel().randomField()->isLocal() &&
               !bodies.getFreeMotion().turnsWithBodies();
    }
    /** Slips of the model's random field at the poses set last: one column of covariance M. */
    virtual void slipsOf(RandomField& field, MatrixXd& slips);
    /**
     * The divergence of nearestTwists() of the field's slips with respect to the bodies'
     * coordinates, at the poses set last. Where the field's gradients are known, they give the
     * divergence. Otherwise six displacements of all bodies at once give it by differences, since a
     * body's twists depend on its own pose only. Fixed components take no part.
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
    std::unique_ptr<MobilityAt> sites;  // the model with all particles, at the poses set last
    MatrixXd forcesOfSites, velocitiesOfSites;
    MatrixXd fieldSlips, gradients, askedTwists;
    MatrixXd slipsOfFlow, noWrenches, spinsOfFlow, slipsOfSpins;
    std::vector<Eigen::Matrix3d> askedTurns;
};

}  // namespace RigidHIPlugin

#endif
