#ifndef RIGIDHI_FLUID_H_
#define RIGIDHI_FLUID_H_

#include <openmm/System.h>

#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "fluid/FluidGroup.h"
#include "fluid/FluidSettings.h"
#include "fluid/StepResolution.h"
#include "fluid/UserFlow.h"
#include "host/FreeParticles.h"
#include "host/PlatformLoops.h"
#include "openmmrigidhi/ModelTraits.h"
#include "rigidbody/BodySet.h"
#include "rigidbody/Thermostat.h"
#include "schemes/SchemeMemory.h"

namespace RigidHIPlugin {

/**
 * The fluid of one Context: which bodies feel each other (groups), the mobility of each group, and
 * the effect of the fluid on momenta.
 *
 * A group is a set of elements with a matrix of its own: the bodies of a replica, or one body under
 * FreeDraining. A body that is alone in a homogeneous fluid has a constant tensor in its own frame.
 * If the tensor is isotropic too (a sphere about its centre), the body is done by a Thermostat like
 * that of Langevin C, and relax() has nothing to do for it.
 */
class Fluid {
public:
    /** The groups come from GroupBuilder. @throws OpenMMException as GroupBuilder does */
    Fluid(const MobilityForce& force, const FluidSettings& settings, const OpenMM::System& system,
          const std::vector<std::vector<int>>& particlesOfBodies,
          const std::vector<BodyGeometry>& geometries, const BodySet& bodies,
          const FreeParticles& freeParticles, PlatformLoops& loops);

    /**
     * Check what the constructor refuses, as far as it does not depend on the shapes of bodies.
     * @throws OpenMMException as the constructor
     */
    static void check(const MobilityForce& force, const FluidSettings& settings,
                      const OpenMM::System& system,
                      const std::vector<std::vector<int>>& particlesOfBodies,
                      const FreeParticles& freeParticles, PlatformLoops& loops);

    const MobilityForce& getForce() const { return force; }
    /** Whether the fluid is made for these settings, or for others that make no difference. */
    bool isMadeFor(const FluidSettings& wanted) const;
    /** Whether a matrix couples anything, so that relax() has something to do. */
    bool couplesBodies() const { return !coupledGroups.empty(); }
    /**
     * Check the inertia that LangevinHI needs, such as zero inertia about the line of collinear
     * blobs.
     * @throws OpenMMException
     */
    void checkInertia(const BodySet& bodies) const;
    /**
     * Check that the forces last gathered do not turn bodies about the line of their collinear
     * blobs, where neither fluid nor inertia resists.
     * @param forces  on all particles; their size gives the size of rounding errors
     * @throws OpenMMException naming the body, for a torque beyond rounding
     */
    void checkTorques(const BodySet& bodies, const std::vector<OpenMM::Vec3>& forces) const;
    /**
     * The factors of one step for a body that no matrix couples. For a coupled body they are all
     * zeros and ones.
     */
    Thermostat bodyThermostat(int body, const BodyInertia& inertia, double kT, double h) const;
    /**
     * The same factors for a free particle. @return false if the fluid does not see the particle
     */
    bool freeThermostat(int freeParticle, double mass, double kT, double h,
                        Thermostat& thermostat) const;

    /**
     * The fluid's part of LangevinHI: momenta of bodies and velocities of free particles over the
     * time h at the present poses (Davidchack 2017, eq. 26). @return random numbers drawn
     */
    LoopResult relax(double h, double kT, const NoiseStream& noise, BodySet& bodies,
                     const FreeParticles& freeParticles, const std::vector<OpenMM::Vec3>& positions,
                     std::vector<OpenMM::Vec3>& velocities);

    /** Begin a step without momenta: every group is at its start, for its first attempt. */
    void beginOverdamped(CustomRigidHIIntegrator::Scheme scheme);
    /** End it: what was recorded of the step becomes the last step. A step that fails leaves the
     * last step as it was. */
    void endOverdamped();
    /**
     * The next stage. Groups that were redone make it an earlier one. It is the scheme's number of
     * stages if no stage is left.
     */
    int nextStage() const;
    /**
     * Run a stage of the step for the groups whose next stage it is. It begins at the present poses
     * of bodies and free particles, with the forces last gathered if the stage wants any. It ends
     * where the next stage wants forces, or at the end of the step. Groups that are further on
     * return to where they were.
     * @return random numbers drawn, whether the new poses are finite
     */
    LoopResult runStage(int stage, const StepSettings& settings, BodySet& bodies,
                        const FreeParticles& freeParticles, std::vector<OpenMM::Vec3>& positions);
    struct Rejections {
        int number = 0;         // of groups
        int attempts = 0;       // largest number in a row of one group
        std::string objection;  // reason for the first group with so many
    };
    /**
     * Take groups that the last stage led to where the model has no mobility back to the start of
     * the step (poses and forces), each by itself, for their next attempt.
     */
    Rejections takeBackRejected(const BodySet::Snapshot& bodiesAtStart,
                                const FreeParticles::Snapshot& freeAtStart, BodySet& bodies,
                                FreeParticles& freeParticles, std::vector<OpenMM::Vec3>& positions);
    /**
     * Move the groups that are further on to where their forces of a stage were evaluated, while
     * forces are evaluated for the other groups.
     */
    void showStage(int stage, BodySet& bodies, std::vector<OpenMM::Vec3>& positions) const;
    /**
     * What a step of a scheme without momenta does to each body by itself (at kT = 0 nothing), and
     * whether forces turn bodies whose spin is slowed.
     */
    StepResolution resolveOverdamped(double h, double kT) const;
    /** Whether the steps so far show such forces. */
    bool drivesSlowedSpins() const;
    /** The rates at which the fluid damps the momenta of a body by itself, at least. */
    BodyRates findRates(int body, const BodyInertia& inertia) const;
    /** How far momenta relax in a step of LangevinHI. */
    StepResolution resolveRelaxation(double h, const BodySet& bodies,
                                     const FreeParticles& freeParticles) const;
    /**
     * The root mean square of nu - 1 of drift-correctors over steps so far, for the group where it
     * is largest; 0 before there are enough steps to tell.
     */
    double getDriftFactorSpread() const;
    /**
     * Vectors that the scheme keeps between steps (OverdampedScheme::memory()): restored as they
     * were when the step began; forgotten; returned for saving.
     */
    void restoreMemory();
    void forgetMemory();
    SchemeMemory getMemory() const;
    /**
     * @throws OpenMMException if the memory is not of these groups, or damaged. The memory of
     *     another scheme is ignored
     */
    void checkMemory(const SchemeMemory& memory, CustomRigidHIIntegrator::Scheme scheme) const;
    /** Set the memory. Errors as in checkMemory(), after which nothing is changed. */
    void setMemory(const SchemeMemory& memory, CustomRigidHIIntegrator::Scheme scheme);

    /** The matrices of bodies, 6n x 6n: free particles are force-free. */
    Eigen::MatrixXd mobility(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    Eigen::MatrixXd friction(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    Eigen::VectorXd apply(const Eigen::VectorXd& wrenches, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions);

    /** Velocities of all particles of the System, three rows each, from forces on them, without
     * rigidity. */
    Eigen::VectorXd applyToBlobs(const Eigen::VectorXd& forces, const BodySet& bodies,
                                 const std::vector<OpenMM::Vec3>& positions);

    /**
     * Poses of bodies and free particles, and what acts on them, when a user asks for the flow of
     * the fluid.
     */
    struct FlowQuestion {
        const BodySet& bodies;
        const FreeParticles& freeParticles;
        const std::vector<OpenMM::Vec3>& positions;
        const std::vector<OpenMM::Vec3>& velocities;
        CustomRigidHIIntegrator::Scheme scheme;  // of the integrator at present
        bool hasMomenta() const { return traitsOf(scheme).hasMomenta; }
    };
    /**
     * Whether the last step without momenta led to the present poses of bodies and particles, in
     * the present box.
     */
    bool lastStepIsPresent(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    /**
     * Whether lastStepIsPresent(), and the last step leads to the same poses when it is done again.
     * If so, the flow of that step is given. If not, the flow is that of the forces last gathered.
     */
    bool findFlowOfLastStep(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions,
                            CustomRigidHIIntegrator::Scheme scheme);
    /**
     * Velocities of the fluid at points: of the last step, at the poses where its forces were
     * evaluated; or of the present forces or (LangevinHI) velocities.
     * @throws OpenMMException for several groups, FreeDraining, and points beyond walls
     */
    Velocities flowAt(const std::vector<OpenMM::Vec3>& points, const FlowQuestion& question);
    /**
     * The amplitudes of sin(k x_b) e_a and cos(k x_b) e_a of the same flow. @throws OpenMMException
     * as flowAt(), and for a boundary without such modes
     */
    std::array<double, 2> flowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                   const FlowQuestion& question);
    /** The amplitudes for the model's random field alone, for nu = 1; 0 where there is none. */
    std::array<double, 2> randomFlowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                         const FlowQuestion& question);
    /**
     * Data from which the last step can be done again, for saving; empty where no step is known.
     */
    SchemeMemory getLastStep() const;
    /**
     * @throws OpenMMException if the data are not of these groups, or damaged. The data of a scheme
     *     that is not known are ignored
     */
    void checkLastStep(const SchemeMemory& saved) const;
    /** Set the data. Errors as in checkLastStep(), after which nothing is changed. */
    void setLastStep(const SchemeMemory& saved);

    /** Set the vectors of the Context's periodic box; zeros, as at first: there is none. */
    void setBox(const BoxVectors& box);
    const BoxVectors& getBox() const { return box; }
    /** Whether setWallRejection() matters. */
    bool hasWalls() const { return traitsOf(force.getBoundary()).hasWalls(); }
    /** Whether the fluid has a periodic box. In other fluids nothing changes with the box. */
    bool isPeriodic() const { return !isFreeDraining() && force.usesPeriodicBoundaryConditions(); }
    /** @throws OpenMMException if a body of a periodic fluid does not fit into the box, naming it,
     * its length, the box and the remedy */
    void checkBox();
    /** @throws OpenMMException if the wave of a force density is not one of this box, or too short
     * for the model */
    void checkWave() const;
    /**
     * Why the model has no mobility at the present poses, naming particles; empty where it has one.
     */
    std::string objection(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    /** Whether objection() can ever return a reason. */
    bool mayObject() const;

    /** For describeEffects(): the flow that users drive; empty: there is none. */
    std::string describeFlow() const;
    /** For describeEffects(): what the fluid is, and how many groups are solved in which way. */
    std::string describe(const SchemeTraits& scheme) const;
    /**
     * For describeEffects(): the method by which mobility(), friction() and apply() are computed,
     * whatever the scheme.
     */
    std::string describeAnswers() const;
    /**
     * For describeEffects(), for a scheme without momenta: "stochastic drift" and "finite
     * differences".
     */
    std::map<std::string, std::string> describeDrift(const SchemeTraits& scheme, double kT,
                                                     double difference) const;
    /** Whether div N is not 0 somewhere, so that a scheme without momenta that omits it is wrong.
     */
    bool hasStochasticDrift() const;
    /**
     * The number of bodies whose hydrodynamic particles are on a line, about which the fluid does
     * not turn them.
     */
    int numCollinear() const;
    /**
     * Whether a body that is alone in its group feels only the fluid around it: no wall, and no
     * images of its own.
     */
    bool isUniform() const { return isFreeDraining() || traitsOf(force.getBoundary()).isUniform(); }
    bool isFreeDraining() const { return force.getModel() == MobilityForce::FreeDraining; }
    int getNumGroups() const { return groups.size(); }
    /** The number of bodies and free particles that are not alone in their group. */
    int numInteracting() const;
    /** Times of the grid, and of Krylov methods without its products. */
    GridSeconds getGridSeconds() const;
    double getSecondsOfSolver() const { return secondsOfSolverBefore + costs().secondsOfSolver; }
    long long numProducts() const;
    long long numMatrices() const;
    long long numIterations = 0, numSquareRoots = 0;
    /**
     * Go on from where another fluid of this Context stopped, with its counters and the memory of
     * the scheme.
     */
    void continueFrom(const Fluid& before);

private:
    /** Groups by what their stochastic drift is. */
    struct Drifts {
        std::vector<FluidGroup*> differenced;  // by finite differences, where the scheme has them
        int known = 0, zero = 0,
            ofSpheres = 0;  // known for a body alone in a uniform fluid; the same, and 0; 0 for
                            // spheres that feel each other
        int numNotZero() const { return differenced.size() + known; }
    };
    Drifts findDrifts() const;
    void findAlone(FluidGroup& group) const;
    void findRotations(FluidGroup& group, double doubleEnergy) const;
    void slowSpins(FluidGroup& group, double doubleEnergy) const;
    void noteDrivenSpins(FluidGroup& group, double h, double kT) const;
    void checkTorque(const FluidGroup& group, int element,
                     const Eigen::Matrix<double, 6, 1>& wrench_body, double siteForces) const;
    OverdampedMove& moveOf(FluidGroup& group) const;
    OverdampedScheme& schemeOf(FluidGroup& group) const;
    void restoreMemory(FluidGroup& group) const;
    bool differencesIterate(FluidGroup& group, const SchemeTraits& scheme) const;
    double differenceOf(FluidGroup& group, const SchemeTraits& scheme, double wanted) const;
    void takeForces(FluidGroup& group, const BodySet& bodies,
                    const FreeParticles& freeParticles) const;
    bool writePlaces(const FluidGroup& group, const std::vector<Pose>& places, BodySet& bodies,
                     std::vector<OpenMM::Vec3>& positions) const;
    std::string objection(FluidGroup& group, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions) const;
    /** The mobility that answers users, to their tolerance, at the present poses. */
    BodyMobility& answering(FluidGroup& group, const BodySet& bodies,
                            const std::vector<OpenMM::Vec3>& positions) const;
    MobilityCosts costs() const;

    /**
     * Groups are spread over threads where they cost more than waking the threads, about 1e-4 s
     * (benchmarks/README.md).
     */
    static constexpr double worthThreads = 1e6, operationsOfConstantTensor = 1000;

    const MobilityForce force;
    const UserFlow userFlow;
    const FluidSettings settings;
    PlatformLoops& loops;
    const std::vector<std::vector<int>> particlesOfBodies;
    const std::vector<std::unique_ptr<FluidGroup>> groups;
    std::vector<FluidGroup*> coupledGroups;
    mutable std::map<std::vector<double>, std::shared_ptr<const CoupledBodies::Alone>>
        aloneOfShapes;
    double operationsPerStep = 0;               // of the coupled groups, roughly
    std::vector<int> elementOfBody;             // in its group
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
    void setTolerance(FluidGroup& group, const SchemeTraits& scheme,
                      const OverdampedStep& step) const;
    /** The flow of one group: its sources, and the move that has its random field. */
    struct FlowOfGroup {
        FlowOfStep made;
        std::unique_ptr<OverdampedMove> move;
        bool isOfLastStep = false;
        double randomFlow =
            0;  // what a random field of unit temperature and time is multiplied by in the step
    };
    std::unique_ptr<FlowOfGroup>
        flowOfLastStep;  // the last answer; forgotten where anything changes
    void replay(FluidGroup& group, FlowOfGroup& flowOfGroup) const;
    void flowOfForces(FluidGroup& group, const BodySet& bodies, const FreeParticles& freeParticles,
                      const std::vector<OpenMM::Vec3>& positions, FlowOfGroup& flowOfGroup) const;
    void flowOfVelocities(FluidGroup& group, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions,
                          const std::vector<OpenMM::Vec3>& velocities,
                          FlowOfGroup& flowOfGroup) const;
    template <class Add>
    void forSources(FluidGroup& group, FlowOfGroup& flowOfGroup, const Add& add) const;
    /**
     * Whether there is one fluid that bodies share, so that its flow can be asked for. Otherwise no
     * data of steps are kept.
     */
    bool hasOneFlow() const {
        return groups.size() == 1 && force.getModel() != MobilityForce::FreeDraining;
    }
    FluidGroup& onlyGroup(const char* method) const;
    FluidGroup& groupWithWave(const char* method, int forceAxis, int waveAxis, int waveVectorIndex,
                              DrivenFlow& wave) const;
    FlowOfGroup& findFlow(FluidGroup& group, const FlowQuestion& question);
    std::string describeBox() const;
};

}  // namespace RigidHIPlugin

#endif
