#ifndef RIGIDHI_FLUID_H_
#define RIGIDHI_FLUID_H_

#include <openmm/System.h>

#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "fluid/FlowReader.h"
#include "fluid/FluidGroup.h"
#include "fluid/FluidSettings.h"
#include "fluid/UserFlow.h"
#include "host/FreeParticles.h"
#include "host/PlatformLoops.h"
#include "openmmrigidhi/ModelTraits.h"
#include "rigidbody/BodySet.h"
#include "rigidbody/Thermostat.h"
#include "schemes/SchemeMemory.h"

namespace RigidHIPlugin {

/** "the periodic box (…) …, nm", for messages. */
std::string textOf(const BoxVectors& box);

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

    /** Reads the flow of the fluid for users. */
    FlowReader& getFlowReader() { return flowReader; }
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

    // ---- What the fluid consists of, for reports
    const std::vector<std::unique_ptr<FluidGroup>>& getGroups() const { return groups; }
    int getGroupOfBody(int body) const { return groupOfBody[body]; }
    int getElementOfBody(int body) const { return elementOfBody[body]; }
    const FluidSettings& getSettings() const { return settings; }
    /** The flow that users drive, in the box; null: none. */
    const DrivenFlow* getFlow() const { return driven; }
    /** The number of bodies that the fluid sees, and of free particles. */
    int getNumBodies() const;
    int getNumFree() const;
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
    void checkTorque(const FluidGroup& group, int element,
                     const Eigen::Matrix<double, 6, 1>& wrench_body, double siteForces) const;
    std::string objection(FluidGroup& group, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions) const;
    /** The mobility that answers users, to their tolerance, at the present poses. */
    BodyMobility& answering(FluidGroup& group, const BodySet& bodies,
                            const std::vector<OpenMM::Vec3>& positions) const;
    MobilityCosts costs() const;
    /**
     * Whether there is one fluid that bodies share, so that its flow can be asked for. Otherwise no
     * data of steps are kept.
     */
    bool hasOneFlow() const {
        return groups.size() == 1 && force.getModel() != MobilityForce::FreeDraining;
    }

    /**
     * Groups are spread over threads where they cost more than waking the threads, about 1e-4 s
     * (benchmarks/README.md).
     */
    static constexpr double worthThreads = 1e6;

    const MobilityForce force;
    const UserFlow userFlow;
    const FluidSettings settings;
    PlatformLoops& loops;
    const std::vector<std::vector<int>> particlesOfBodies;
    const std::vector<std::unique_ptr<FluidGroup>> groups;
    std::vector<FluidGroup*> coupledGroups;
    double operationsPerStep = 0;               // of the coupled groups, roughly
    std::vector<int> elementOfBody;             // in its group
    std::vector<int> groupOfBody, groupOfFree;  // free: by place in FreeParticles, -1: not seen
    CustomRigidHIIntegrator::Scheme schemeOfSteps =
        CustomRigidHIIntegrator::EulerMaruyama;  // of the groups
    long long productsBefore = 0,
              matricesBefore = 0;  // of the fluids before this one in the Context
    GridSeconds gridSecondsBefore;
    double secondsOfSolverBefore = 0;
    BoxVectors box = {};
    bool boxIsChecked = false;
    DrivenFlow flow;                     // in this box
    const DrivenFlow* driven = nullptr;  // the flow, if there is one
    FlowReader flowReader{{force, groups, driven, box, hasOneFlow()}};
};

}  // namespace RigidHIPlugin

#endif
