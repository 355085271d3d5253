#ifndef RIGIDHI_FLUID_H_
#define RIGIDHI_FLUID_H_

#include <openmm/System.h>

#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "context/SavedState.h"
#include "fluid/FluidGroup.h"
#include "fluid/UserFlow.h"
#include "host/PlatformLoops.h"
#include "openmmrigidhi/MobilityForce.h"
#include "rigidbody/BodySet.h"
#include "schemes/Thermostat.h"
#include "stepping/FreeParticles.h"

namespace RigidHIPlugin {

/**
 * The fluid of one Context: who feels whom (groups), each group's mobility, and what it does to
 * momenta.
 *
 * A group is what needs a matrix of its own: the bodies of a replica, or one body under
 * FreeDraining. A body that is alone in a homogeneous fluid has a constant tensor in its own frame;
 * if that is isotropic too (a sphere about its centre), it is a Thermostat like those of Langevin
 * C, and the fluid's part has nothing to do for it.
 */
class Fluid {
public:
    /** Its groups are GroupBuilder's. @throws OpenMMException as that does */
    Fluid(const MobilityForce& force, CustomRigidHIIntegrator::WallRejection wallRejection,
          const OpenMM::System& system, const std::vector<std::vector<int>>& particlesOfBodies,
          const std::vector<BodyGeometry>& geometries, const BodySet& bodies,
          const FreeParticles& freeParticles, PlatformLoops& loops);

    /**
     * What the constructor refuses, as far as that does not depend on the shapes of bodies.
     * @throws OpenMMException likewise
     */
    static void check(const MobilityForce& force,
                      CustomRigidHIIntegrator::WallRejection wallRejection,
                      const OpenMM::System& system,
                      const std::vector<std::vector<int>>& particlesOfBodies,
                      const FreeParticles& freeParticles, PlatformLoops& loops);

    const MobilityForce& getForce() const { return force; }
    CustomRigidHIIntegrator::WallRejection getWallRejection() const { return wallRejection; }
    /** Whether a matrix couples anything, so that relax() has something to do. */
    bool couplesBodies() const { return !coupledGroups.empty(); }
    /** What LangevinHI needs of it: zero inertia about the line of collinear blobs, and so on.
     * @throws OpenMMException */
    void checkInertia(const BodySet& bodies) const;
    /**
     * Forces as last gathered must not turn bodies about the line of their collinear blobs, where
     * neither fluid nor inertia resists.
     * @param forces  on all particles, whose size says what rounding is
     * @throws OpenMMException naming the body, beyond rounding
     */
    void checkTorques(const BodySet& bodies, const std::vector<OpenMM::Vec3>& forces) const;
    /** The factors of one step for what no matrix couples: all zeros and ones for what one does. */
    Thermostat bodyThermostat(int body, const BodyInertia& inertia, double kT, double h) const;
    /** Likewise of a free particle; false if the fluid does not see it. */
    bool freeThermostat(int freeParticle, double mass, double kT, double h,
                        Thermostat& thermostat) const;

    /**
     * The fluid's part of LangevinHI: momenta of bodies and velocities of free particles over the
     * time h at the present poses (Davidchack 2017, eq. 26). @return random numbers drawn
     */
    LoopResult relax(double h, double kT, const NoiseStream& noise, BodySet& bodies,
                     const FreeParticles& freeParticles, const std::vector<OpenMM::Vec3>& positions,
                     std::vector<OpenMM::Vec3>& velocities);

    /** A step without momenta begins: every group is at its start, for its first attempt. */
    void beginOverdamped(CustomRigidHIIntegrator::Scheme scheme);
    /** The stage that is next: of groups that were redone, an earlier one. The scheme's number of
     * stages if there is none. */
    int nextStage() const;
    /**
     * A stage of the step, for the groups whose next one it is: from the poses that bodies and free
     * particles have, and the forces as last gathered if the stage wants any, to where the next
     * stage wants forces, or to the end. Groups that are further return to where they were.
     * @return random numbers drawn, whether the new poses are finite
     */
    LoopResult runStage(int stage, const StepSettings& settings, BodySet& bodies,
                        const FreeParticles& freeParticles, std::vector<OpenMM::Vec3>& positions);
    struct Rejections {
        int number = 0;         // of groups
        int attempts = 0;       // most in a row of one of them
        std::string objection;  // to the first with so many
    };
    /**
     * Groups that the last part led to where the model has no mobility go back, by themselves, to
     * the start of the step (poses and forces) for their next attempt.
     */
    Rejections takeBackRejected(const BodySet::Snapshot& bodiesAtStart,
                                const FreeParticles::Snapshot& freeAtStart, BodySet& bodies,
                                FreeParticles& freeParticles, std::vector<OpenMM::Vec3>& positions);
    /** Groups that are further go to where their forces of a stage were evaluated, while others are
     * to have theirs. */
    void showStage(int stage, BodySet& bodies, std::vector<OpenMM::Vec3>& positions) const;
    /** How far the drift factors of drift-correctors are from 1, root mean square over steps so
     * far, of the group where most; 0 before there are enough steps to tell. */
    double getDriftFactorSpread() const;
    /** What the scheme keeps between steps (OverdampedScheme::memory()): as it was when the step
     * began; forgotten; to be saved. */
    void restoreMemory();
    void forgetMemory();
    SchemeMemory getMemory() const;
    /** @throws OpenMMException if it is not of these groups, or damaged; another scheme's is left
     * out */
    void checkMemory(const SchemeMemory& memory, CustomRigidHIIntegrator::Scheme scheme) const;
    /** Likewise; then nothing was changed. */
    void setMemory(const SchemeMemory& memory, CustomRigidHIIntegrator::Scheme scheme);

    /** 6n x 6n, bodies only: free particles are force-free. */
    Eigen::MatrixXd mobility(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    Eigen::MatrixXd friction(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    Eigen::VectorXd apply(const Eigen::VectorXd& wrenches, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions);

    /** Velocities of all particles of the System, three rows each, from forces on them, without
     * rigidity. */
    Eigen::VectorXd applyToBlobs(const Eigen::VectorXd& forces, const BodySet& bodies,
                                 const std::vector<OpenMM::Vec3>& positions);

    /** Where bodies and free particles are, and what acts on them, when somebody asks for the flow
     * of the fluid. */
    struct FlowQuestion {
        const BodySet& bodies;
        const FreeParticles& freeParticles;
        const std::vector<OpenMM::Vec3>& positions;
        const std::vector<OpenMM::Vec3>& velocities;
        bool hasMomenta;
    };
    /** Whether the last step without momenta led to where bodies and particles are, in the box that
     * there is. */
    bool lastStepIsPresent(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    /** Likewise, and, done again, leads there once more: then its flow is answered. If not, that of
     * the forces as last gathered. */
    bool findFlowOfLastStep(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    /**
     * Velocities of the fluid at points: of the last step, at the poses where it had its forces; or
     * of the present forces or (LangevinHI) velocities.
     * @throws OpenMMException for several groups, FreeDraining, and points beyond walls
     */
    Velocities flowAt(const std::vector<OpenMM::Vec3>& points, const FlowQuestion& question);
    /** Likewise the amplitudes of sin(k x_b) e_a and cos(k x_b) e_a. @throws OpenMMException also
     * for a boundary without such modes */
    std::array<double, 2> flowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                   const FlowQuestion& question);
    /** Likewise of the model's random field alone, for nu = 1; 0 where there is none. */
    std::array<double, 2> randomFlowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                         const FlowQuestion& question);
    /** What the last step can be done again from, to be saved; without groups: nothing. */
    SchemeMemory getLastStep() const;
    /** @throws OpenMMException if it is not of these groups, or damaged; another scheme's is left
     * out */
    void checkLastStep(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) const;
    /** Likewise; then nothing was changed. */
    void setLastStep(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme);

    /** The vectors of the Context's periodic box, from now on; zeros, as at first: there is none.
     */
    void setBox(const BoxVectors& box);
    const BoxVectors& getBox() const { return box; }
    /** Whether setWallRejection() matters. */
    bool hasWalls() const {
        return force.getBoundary() == MobilityForce::NoSlipWall ||
               force.getBoundary() == MobilityForce::SlipChannel;
    }
    /** Whether it has one: of others nothing changes with the box. */
    bool isPeriodic() const { return force.usesPeriodicBoundaryConditions(); }
    /** @throws OpenMMException if a body of a periodic fluid does not fit into the box, naming it,
     * its length, the box and the remedy */
    void checkBox();
    /** @throws OpenMMException if the wave of a force density is not one of this box, or too short
     * for the model */
    void checkWave() const;
    /** Why the model has no mobility at the present poses, naming particles; empty where it has
     * one. */
    std::string objection(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    /** Whether objection() can ever object. */
    bool mayObject() const;

    /** For describeEffects(): the flow that users drive; empty: there is none. */
    std::string describeFlow() const;
    /** Likewise: what the fluid is, and how many groups are solved in which way. */
    std::string describe(bool overdamped) const;
    /** Likewise: by which way mobility(), friction() and apply() are answered, whatever the scheme.
     */
    std::string describeAnswers() const;
    /** Likewise of a scheme without momenta: "stochastic drift" and "finite differences". */
    std::map<std::string, std::string> describeDrift(const SchemeTraits& scheme, double kT,
                                                     double difference) const;
    /** Whether div N is not 0 somewhere, so that a scheme without momenta that omits it is wrong.
     */
    bool hasStochasticDrift() const;
    /** Bodies whose hydrodynamic particles are on a line, about which the fluid does not turn them.
     */
    int numCollinear() const;
    /** Whether a body that is alone in its group feels nothing but the fluid around it: no wall,
     * and no images of its own. */
    bool isUniform() const { return force.getBoundary() == MobilityForce::Unbounded; }
    int getNumGroups() const { return groups.size(); }
    /** Bodies and free particles that are not alone in their group. */
    int numInteracting() const;
    /** What a grid has taken, and Krylov methods beside its products. */
    GridSeconds getGridSeconds() const;
    double getSecondsOfSolver() const { return secondsOfSolverBefore + costs().secondsOfSolver; }
    long long numProducts() const;
    long long numMatrices() const;
    long long numIterations = 0, numSquareRoots = 0;
    /** Go on from where another fluid of this Context stopped: counters, and what the scheme keeps
     * between steps. */
    void continueFrom(const Fluid& before);

private:
    /** Groups by what their stochastic drift is. */
    struct Drifts {
        std::vector<const FluidGroup*>
            differenced;  // by finite differences, where the scheme has them
        int known = 0, zero = 0,
            ofSpheres =
                0;  // alone in a uniform fluid; so, and 0; 0 for spheres that feel each other
        int numNotZero() const { return differenced.size() + known; }
    };
    Drifts findDrifts() const;
    void checkTorque(const FluidGroup& group, int element,
                     const Eigen::Matrix<double, 6, 1>& wrench_body, double siteForces) const;
    OverdampedMove& moveOf(FluidGroup& group) const;
    OverdampedScheme& schemeOf(FluidGroup& group) const;
    void restoreMemory(FluidGroup& group) const;
    bool differencesIterate(const FluidGroup& group, const SchemeTraits& scheme) const;
    double differenceOf(const FluidGroup& group, const SchemeTraits& scheme, double wanted) const;
    void takeForces(FluidGroup& group, const BodySet& bodies,
                    const FreeParticles& freeParticles) const;
    bool writePlaces(const FluidGroup& group, const std::vector<Pose>& places, BodySet& bodies,
                     std::vector<OpenMM::Vec3>& positions) const;
    std::string objection(FluidGroup& group, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions) const;
    /** What users ask for, to their tolerance, at the present poses. */
    BodyMobility& answering(FluidGroup& group, const BodySet& bodies,
                            const std::vector<OpenMM::Vec3>& positions) const;
    MobilityCosts costs() const;

    /** Groups are spread over threads where they cost more than waking these, about 1e-4 s
     * (benchmarks/README.md). */
    static constexpr double worthThreads = 1e6, operationsOfConstantTensor = 1000;

    const MobilityForce force;
    const UserFlow userFlow;
    const CustomRigidHIIntegrator::WallRejection wallRejection;
    PlatformLoops& loops;
    const std::vector<std::vector<int>> particlesOfBodies;
    const std::vector<std::unique_ptr<FluidGroup>> groups;
    std::vector<FluidGroup*> coupledGroups;
    double operationsPerStep = 0;               // of these, roughly
    std::vector<int> groupOfBody, groupOfFree;  // free: by place in FreeParticles, -1: not seen
    CustomRigidHIIntegrator::Scheme overdampedScheme_ =
        CustomRigidHIIntegrator::EulerMaruyama;  // of the groups' schemes
    long long productsBefore = 0,
              matricesBefore = 0;  // of the fluids before this one in the Context
    GridSeconds gridSecondsBefore;
    double secondsOfSolverBefore = 0;
    BoxVectors box = {};
    bool boxIsChecked = false;
    DrivenFlow flow;  // in this box
    bool isDriven = false;
    const DrivenFlow* flowIfAny() const { return isDriven ? &flow : nullptr; }
    void setTolerance(FluidGroup& group, const SchemeTraits& scheme, double difference) const;
    /** The flow of one group: whose particles it comes from, and the move whose random field it
     * has. */
    struct FlowOfGroup {
        FlowOfStep made;
        std::unique_ptr<OverdampedMove> move;
        bool isOfLastStep = false;
        double randomFlow =
            0;  // what a random field of unit temperature and time is multiplied by in the step
    };
    std::unique_ptr<FlowOfGroup>
        flowOfLastStep;  // as answered last; forgotten where anything changes
    void replay(FluidGroup& group, FlowOfGroup& flowOfGroup) const;
    void flowOfForces(FluidGroup& group, const BodySet& bodies, const FreeParticles& freeParticles,
                      const std::vector<OpenMM::Vec3>& positions, FlowOfGroup& flowOfGroup) const;
    void flowOfVelocities(FluidGroup& group, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions,
                          const std::vector<OpenMM::Vec3>& velocities,
                          FlowOfGroup& flowOfGroup) const;
    template <class Add>
    void forSources(FluidGroup& group, FlowOfGroup& flowOfGroup, const Add& add) const;
    /** Whether there is one fluid that bodies share, so that its flow can be asked for. Otherwise
     * nothing is kept of steps. */
    bool hasOneFlow() const {
        return groups.size() == 1 && force.getModel() != MobilityForce::FreeDraining;
    }
    FluidGroup& onlyGroup(const char* method) const;
    FluidGroup& groupWithWave(const char* method, int forceAxis, int waveAxis, int waveVectorIndex,
                              DrivenFlow& wave) const;
    bool isLastStepOf(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) const;
    FlowOfGroup& findFlow(FluidGroup& group, const FlowQuestion& question);
    std::string describeBox() const;
};

}  // namespace RigidHIPlugin

#endif
