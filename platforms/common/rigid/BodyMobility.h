#ifndef RIGIDHI_BODY_MOBILITY_H_
#define RIGIDHI_BODY_MOBILITY_H_

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "mobility/RandomField.h"
#include "rigid/BodiesAt.h"
#include "rigid/SlipSpace.h"

namespace RigidHIPlugin {

/**
 * The mobility of one group of bodies at one configuration: all that callers ask of the fluid. How
 * it is made are strategies:
 *
 * ConstantMobility  of a body alone in a uniform fluid: a tensor, known once
 * DenseMobility     by matrices: Cholesky's factors of M and of the friction
 * KrylovMobility    by products with M alone: MultiblobSolver for U and Lanczos for the noise, to
 * the tolerance
 *
 * Equation:  M lambda + s = K U, K^T lambda = F, so U = N (F + K^T M^-1 s), N = (K^T M^-1 K)^-1:
 * the twists U of bodies under wrenches F whose particles have the slips (random velocities) s
 * (Westwood 2022, eqs. 33 to 36). Noise:     slips have the covariance M, thermalWrench() that of
 * the friction N^-1; so both N thermalWrench() and N K^T M^-1 times slips have the covariance N.
 * The model's own random field is asked first (slipsOf()); thermalSlip() and thermalWrench() are
 * differentiable functions of the configuration for given random numbers W (Cholesky factors,
 * symmetric square roots). Slips:     live where SlipSpace says. A collinear body's null twist has
 * no noise and no velocity.
 *
 * Columns of wrenches, slips and twists are cases of their own. Nothing is allocated after the
 * first call with as many columns, but by KrylovMobility. All that is cached belongs to a
 * configuration; another (multiplyNearby()) has a place of its own.
 */
class BodyMobility {
public:
    typedef Eigen::MatrixXd MatrixXd;
    enum Way { Constant, Dense, Krylov };

    explicit BodyMobility(const CoupledBodies& bodies) : bodies(bodies), slipSpace(bodies) {}
    virtual ~BodyMobility() {}
    virtual Way getWay() const = 0;
    const CoupledBodies& getBodies() const { return bodies; }
    const SlipSpace& getSlipSpace() const { return slipSpace; }

    // ---- Where, and how well
    /**
     * @param nearby  the poses are a small displacement of accepted ones: MobilityModel::near()
     * @throws OpenMMException  as BodiesAt::setPoses()
     */
    virtual void setPoses(const std::vector<Pose>& poses, bool nearby = false) = 0;
    const std::vector<Pose>& posesHere() const { return getPoses(); }
    /** The rotation of an element at the poses set last. */
    const Eigen::Matrix3d& getTurn(int element) const { return getTurns()[element]; }
    /**
     * Of what iterates, relative. Exact products: as small finite differences of what iterates want
     * them, which would magnify rounding of single precision; else as MobilityAt::applyFor(). Exact
     * solves: where nothing iterates, products are exact in solve(), as differences of it want
     * them; else they are right to a part of the tolerance.
     */
    virtual void setTolerance(double relative, bool exactProducts = false,
                              bool exactSolves = true) {}
    /** Whether these iterate, and so are right to the tolerance only: multiplyNearby(), solve(),
     * the thermal vectors. */
    virtual bool productsIterate() const { return false; }
    virtual bool solvesIterate() const { return false; }
    virtual bool rootsIterate() const { return false; }
    /** MobilityModel::mayObject(), objection() and acceptsNearby() for bodies at any poses. */
    bool mayObject() const { return bodies.hasModel() && bodies.getModel().mayObject(); }
    std::string objection(const std::vector<Pose>& poses);
    bool acceptsNearby(const std::vector<Pose>& poses);

    // ---- The mobility problem
    /** U = N F */
    void solve(const MatrixXd& wrenches, MatrixXd& twists) { solve(wrenches, noSlips, twists); }
    /** U = N (F + K^T M^-1 s); as many columns of both, or no slips. */
    virtual void solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) = 0;
    /** Keep the forces of blobs of a column of the last solve() for solveFromKept(). Default:
     * nothing. */
    virtual void keepForces(int column) {}
    /**
     * As solve() with one column, which begins at the forces kept last, turned with the bodies: for
     * wrenches, slips and poses that are little different. Iterations only have something of it.
     * Default: solve().
     */
    virtual void solveFromKept(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
        solve(wrenches, slips, twists);
    }
    /** lambda of the last solve(), with its columns. */
    virtual void getBlobForces(MatrixXd& lambda) = 0;
    /** slips = M lambda at poses a small displacement away, beside those set last. */
    virtual void multiplyNearby(const std::vector<Pose>& poses, const MatrixXd& lambda,
                                MatrixXd& slips) = 0;
    /** slips = K U, wrenches = K^T lambda at any poses, and the twists nearest to slips: SlipSpace.
     */
    void rigidSlips(const std::vector<Pose>& poses, const MatrixXd& twists, MatrixXd& slips) {
        slipSpace.rigidSlips(poses, twists, slips);
    }
    void totalWrenches(const std::vector<Pose>& poses, const MatrixXd& lambda, MatrixXd& wrenches) {
        slipSpace.totalWrenches(poses, lambda, wrenches);
    }
    void nearestTwists(const MatrixXd& slips, MatrixXd& twists) const {
        slipSpace.nearestTwists(getTurns(), slips, twists);
    }

    // ---- A driven flow
    /**
     * Its slips where slips live, at the poses set last, so that U = N (F + K^T M^-1 s): of
     * particles, or the twists of bodies without forces. Bodies without hydrodynamic particles
     * follow it at their origin.
     */
    void flowSlips(const DrivenFlow& flow, MatrixXd& slips);
    /** The twists of bodies that are free of forces in it. */
    void flowTwists(const DrivenFlow& flow, MatrixXd& twists);

    // ---- The flow of the fluid
    /** Forces where slips live (of particles, or wrenches of bodies) with which bodies are held at
     * these twists, in a driven flow (null: none). */
    void forcesOfTwists(const MatrixXd& twists, const DrivenFlow* flow, MatrixXd& forces);
    /** Forces f there that would make the slips of thermalSlip() of the same W: M f = s. */
    virtual void forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) = 0;
    /** Forces of particles with M f = s, where slips live on particles. */
    virtual void forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) = 0;
    /** What the fluid's flow comes from when getBlobForces() gave these forces at the poses set
     * last; `flow`: the driven one, if that solve had it. */
    FlowSources flowSources(const MatrixXd& forces, const DrivenFlow* flow);
    /** MobilityAt::addFlowAt() there. */
    void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                   double factor, Velocities& velocities) {
        particlesHere().particles().addFlowAt(sources, points, factor, velocities);
    }
    /** The power of sources there on a flow: of forces on velocities of particles, torques on
     * angular velocities, stresslets on strain rates. */
    double powerOn(const DrivenFlow& flow, const FlowSources& sources) {
        return particlesHere().powerOn(flow, sources);
    }

    // ---- Noise
    /**
     * Draw the model's random field, for any number of poses. @return whether slips are to be taken
     * from it: there is one, and slips live on particles
     */
    bool drawField(const NoiseStream& noise, uint32_t purpose,
                   std::unique_ptr<RandomField>& field) const;
    /** Whether drawField() gives one. */
    bool slipsAreOfField() const {
        return !slipSpace.areOfBodies() && bodies.getModel().hasOwnRandomField();
    }
    /** Whether divergenceOf() knows that of such slips: the field is one flow. */
    bool divergenceIsOfField() const {
        return slipsAreOfField() && bodies.getModel().fieldIsLocal();
    }
    /** Slips of a field of the model's at the poses set last: one column of covariance M. */
    virtual void slipsOf(RandomField& field, MatrixXd& slips);
    /**
     * The divergence by the bodies' coordinates of nearestTwists() of the field's slips, at the
     * poses set last: by its gradients where it knows them, else by differences of six
     * displacements of all bodies at once, since a body's twists depend on its own pose only.
     */
    double divergenceOf(RandomField& field);
    /** Whether W of thermalWrench() has the rows of the bodies; if not, those of the particles. */
    virtual bool wrenchNoiseIsOfBodies() const { return true; }
    /** Likewise W of thermalSlip(). */
    bool slipNoiseIsOfBodies() const { return slipSpace.areOfBodies() && wrenchNoiseIsOfBodies(); }
    /** A wrench with the covariance N^-1. */
    virtual void thermalWrench(const MatrixXd& W, MatrixXd& wrench) = 0;
    /** Slips with the covariance M. */
    virtual void thermalSlip(const MatrixXd& W, MatrixXd& slips) = 0;

    // ---- Its divergence
    /** Whether N is the same at all poses, but for the turn of one body. */
    bool isUniform() const { return bodies.isAloneInUniformFluid(); }
    /** Whether div N = 0 at all poses. Then K = 1, and slips are twists wherever the bodies are. */
    bool isDivergenceFree() const { return bodies.isDivergenceFree(); }
    /** div N of a body alone in a uniform fluid, lab frame: e_k x N_VW e_k, summed; no rotational
     * part. Else 0. */
    virtual Eigen::Vector3d uniformDivergence() const { return Eigen::Vector3d::Zero(); }

    // ---- N itself
    /** N at the poses set last; where iterations take less time, to the tolerance. */
    virtual const MatrixXd& mobility() = 0;
    /** Its (pseudo-)inverse. There are no iterations for it. */
    virtual const MatrixXd& friction() = 0;
    /**
     * twists = N wrenches, as products in a caller's own iteration and users want them: no forces
     * of blobs.
     *
     * @param errorOfProducts  as of MobilityAt::applyWithin(), for those that are not iterated upon
     * here; 0: exact
     */
    virtual void multiply(const MatrixXd& wrenches, MatrixXd& twists,
                          double errorOfProducts = 0) = 0;
    /**
     * velocities = M forces of the elements' particles at the poses set last, as if each were free:
     * three rows for each particle of the System, of which those of these particles are read and
     * written. Spheres take no torque; own tensors have no part in it.
     */
    void applyToParticles(const Eigen::VectorXd& forces, Eigen::VectorXd& velocities);

    const MobilityCosts& getCosts() const { return costs; }

    /** For its life the thread is in a Krylov method whose products may be a grid's: the time
     * beside these is the solver's. They may be nested. */
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
     * The twists of bodies without forces whose particles have these slips of a flow, at the poses
     * set last; own tensors have no part in it. Default: by matrices.
     */
    virtual void forceFreeTwists(const DrivenFlow&, const MatrixXd& slips, MatrixXd& twists) {
        particlesHere().forceFreeTwists(slips, bodies.getNullTwists(), twists);
    }
    /** Forces of particles whose bodies have these wrenches and slips, at the poses set last;
     * likewise. */
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
    double divergenceByGradients(RandomField& field);
    double divergenceByDifferences(RandomField& field);

    SlipSpace slipSpace;
    const MatrixXd noSlips;
    Placement asked;
    MatrixXd fieldSlips, gradients, askedTwists;
    MatrixXd slipsOfFlow, noWrenches;
    std::vector<Eigen::Matrix3d> askedTurns;
};

}  // namespace RigidHIPlugin

#endif
