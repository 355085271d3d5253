#ifndef RIGIDHI_FLUID_H_
#define RIGIDHI_FLUID_H_

#include <openmm/System.h>

#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "context/SavedState.h"
#include "engine/FreeParticles.h"
#include "engine/PlatformLoops.h"
#include "mobility/BodyMobility.h"
#include "mobility/Lanczos.h"
#include "openmmrigidhi/MobilityForce.h"
#include "rigidbody/BodySet.h"
#include "schemes/FluidOrnsteinUhlenbeck.h"
#include "schemes/OverdampedSchemes.h"
#include "schemes/Thermostat.h"

namespace RigidHIPlugin {

/**
 * The fluid of one Context: who feels whom (groups), each group's mobility, and what it does to momenta.
 *
 * A group is what needs a matrix of its own: the bodies of a replica, or one body under FreeDraining. A body that is alone
 * in a homogeneous fluid has a constant tensor in its own frame; if that is isotropic too (a sphere about its centre), it is
 * a Thermostat like those of Langevin C, and the fluid's part has nothing to do for it.
 */
class Fluid {
public:
    /**
     * @param wallRejection  whether surfaces of particles may reach through a wall
     * @throws OpenMMException for radii that are not one per particle, a body without hydrodynamic particles, tensors and
     *         groups of other numbers of bodies, and what the model refuses
     */
    Fluid(const MobilityForce& force, CustomRigidHIIntegrator::WallRejection wallRejection,
          const OpenMM::System& system, const std::vector<std::vector<int>>& particlesOfBodies,
          const std::vector<BodyGeometry>& geometries, const BodySet& bodies, const FreeParticles& freeParticles,
          PlatformLoops& loops);

    /**
     * What the constructor refuses, as far as that does not depend on the shapes of bodies.
     * @throws OpenMMException likewise
     */
    static void check(const MobilityForce& force, CustomRigidHIIntegrator::WallRejection wallRejection,
                      const OpenMM::System& system, const std::vector<std::vector<int>>& particlesOfBodies,
                      const FreeParticles& freeParticles, PlatformLoops& loops);

    const MobilityForce& getForce() const { return force; }
    CustomRigidHIIntegrator::WallRejection getWallRejection() const { return wallRejection; }
    /** Whether a matrix couples anything, so that relax() has something to do. */
    bool couplesBodies() const { return !coupledGroups.empty(); }
    /** What LangevinHI needs of it: zero inertia about the line of collinear blobs, and so on. @throws OpenMMException */
    void checkInertia(const BodySet& bodies) const;
    /**
     * Forces as last gathered must not turn bodies about the line of their collinear blobs, where neither fluid nor inertia resists.
     * @param forces  on all particles, whose size says what rounding is
     * @throws OpenMMException naming the body, beyond rounding
     */
    void checkTorques(const BodySet& bodies, const std::vector<OpenMM::Vec3>& forces) const;
    /** The factors of one step for what no matrix couples: all zeros and ones for what one does. */
    Thermostat bodyThermostat(int body, const BodyInertia& inertia, double kT, double h) const;
    /** Likewise of a free particle; false if the fluid does not see it. */
    bool freeThermostat(int freeParticle, double mass, double kT, double h, Thermostat& thermostat) const;

    /**
     * The fluid's part of LangevinHI: momenta of bodies and velocities of free particles over the time h at the present
     * poses (Davidchack 2017, eq. 26). @return random numbers drawn
     */
    LoopResult relax(double h, double kT, const NoiseStream& noise, BodySet& bodies, const FreeParticles& freeParticles,
                     const std::vector<OpenMM::Vec3>& positions, std::vector<OpenMM::Vec3>& velocities);

    /** A step without momenta begins: every group is at its start, for its first attempt. */
    void beginOverdamped(CustomRigidHIIntegrator::Scheme scheme);
    /** The stage that is next: of groups that were redone, an earlier one. The scheme's number of stages if there is none. */
    int nextStage() const;
    /**
     * A stage of the step, for the groups whose next one it is: from the poses that bodies and free particles have, and the forces as last
     * gathered if the stage wants any, to where the next stage wants forces, or to the end. Groups that are further return to where they were.
     * @return random numbers drawn, whether the new poses are finite
     */
    LoopResult runStage(int stage, const StepSettings& settings, BodySet& bodies, const FreeParticles& freeParticles,
                        std::vector<OpenMM::Vec3>& positions);
    struct Rejections {
        int number = 0;         // of groups
        int attempts = 0;       // most in a row of one of them
        std::string objection;  // to the first with so many
    };
    /**
     * Groups that the last part led to where the model has no mobility go back, by themselves, to the start of the step (poses and forces)
     * for their next attempt.
     */
    Rejections takeBackRejected(const BodySet::Snapshot& bodiesAtStart, const FreeParticles::Snapshot& freeAtStart,
                                BodySet& bodies, FreeParticles& freeParticles, std::vector<OpenMM::Vec3>& positions);
    /** Groups that are further go to where their forces of a stage were evaluated, while others are to have theirs. */
    void showStage(int stage, BodySet& bodies, std::vector<OpenMM::Vec3>& positions) const;
    /** What the scheme keeps between steps (OverdampedScheme::memory()): as it was when the step began; forgotten; to be saved. */
    void restoreMemory();
    void forgetMemory();
    SchemeMemory getMemory() const;
    /** @throws OpenMMException if it is not of these groups; another scheme's is left out */
    void setMemory(const SchemeMemory& memory, CustomRigidHIIntegrator::Scheme scheme);

    /** 6n x 6n, bodies only: free particles are force-free. */
    Eigen::MatrixXd mobility(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    Eigen::MatrixXd friction(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    Eigen::VectorXd apply(const Eigen::VectorXd& wrenches, const BodySet& bodies,
                          const std::vector<OpenMM::Vec3>& positions);

    /** Velocities of all particles of the System, three rows each, from forces on them, without rigidity. */
    Eigen::VectorXd applyToBlobs(const Eigen::VectorXd& forces, const BodySet& bodies,
                                 const std::vector<OpenMM::Vec3>& positions);

    /** The vectors of the Context's periodic box, from now on; zeros, as at first: there is none. */
    void setBox(const BoxVectors& box);
    /** Why the model has no mobility at the present poses, naming particles; empty where it has one. */
    std::string objection(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    /** Whether objection() can ever object. */
    bool mayObject() const;

    /** For describeEffects(): what the fluid is, and how many groups are solved in which way. */
    std::string describe(bool overdamped) const;
    /** Likewise: by which way mobility(), friction() and apply() are answered, whatever the scheme. */
    std::string describeAnswers() const;
    /** Likewise of a scheme without momenta: "stochastic drift" and "finite differences". */
    std::map<std::string, std::string> describeDrift(const SchemeTraits& scheme, double kT, double difference) const;
    /** Whether div N is not 0 somewhere, so that a scheme without momenta that omits it is wrong. */
    bool hasStochasticDrift() const;
    /** Bodies whose hydrodynamic particles are on a line, about which the fluid does not turn them. */
    int numCollinear() const;
    bool isUniform() const { return force.getBoundary() == MobilityForce::Unbounded; }
    int getNumGroups() const { return groups.size(); }
    /** Bodies and free particles that are not alone in their group. */
    int numInteracting() const;
    long long numProducts() const;
    long long numMatrices() const;
    long long numIterations = 0, numSquareRoots = 0;
    /** Go on from where another fluid of this Context stopped: counters, and what the scheme keeps between steps. */
    void continueFrom(Fluid& before);

private:
    /** What LangevinHI needs of a group. */
    struct Relaxation {
        std::vector<int> firstZ, numLive;  // of each element: rows in Z, live axes of a body
        int numZ = 0;
        // Whether bodies lack just those moments about whose axes the fluid does not hold them.
        bool deadAxesAreNull = true;
        bool solvesMatrixFree = false;
        Eigen::VectorXd Z, chi;
        Eigen::MatrixXd half, S;
        FluidOrnsteinUhlenbeck process;
        std::unique_ptr<Lanczos> lanczos;  // where matrix-free
        Eigen::MatrixXd columns, results, wrenches, twists;
        double constantH = -1;  // the step for which `decay` and `noise` hold
        Eigen::MatrixXd decay, noise;
    };
    /** What a scheme without momenta needs of it. */
    struct Overdamped {
        bool matrixFree = false;
        std::unique_ptr<OverdampedMove> move;  // made at the first step without momenta
        std::unique_ptr<OverdampedScheme> scheme;
        std::vector<Eigen::MatrixXd> memoryAtStart;
        int stage = 0;                                  // stages of the present step that are done
        uint32_t attempt = 0;                           // of the present step
        std::string objection;                          // to where the last part led
        bool isFinite = true;                           // where it led
        std::vector<std::vector<Pose>> placesOfForces;  // where those of each stage are evaluated
        long long squareRoots = 0;                      // of the last part
    };
    /** What feels each other. */
    struct Group {
        std::unique_ptr<BodyMobility> mobility;
        std::vector<int> freeIndex;  // of each element in FreeParticles, -1: a body
        std::vector<Pose> poses;
        bool hasNullVectors = false;
        bool isThermostat = false;                 // its tensor is a Thermostat: nothing to be done here
        double drag_t = 0, drag_r[3] = {0, 0, 0};  // then
        bool answersMatrixFree = false;            // in apply()
        Relaxation relaxation;
        Overdamped overdamped;
        long long randomNumbers = 0, iterations = 0;  // of the last step
    };
    /** Groups by what their stochastic drift is. */
    struct Drifts {
        std::vector<const Group*> differenced;  // by finite differences, where the scheme has them
        int known = 0, zero = 0,
            ofSpheres = 0;  // alone in a uniform fluid; so, and 0; 0 for spheres that feel each other
        int numNotZero() const { return differenced.size() + known; }
    };
    Drifts findDrifts() const;
    void chooseSolver(Group& group) const;
    bool answersByColumns(const Group& group) const {
        return group.answersMatrixFree && group.mobility->isWorthIterations();
    }
    void checkTorque(const Group& group, int element, const Eigen::VectorXd& wrench_body, double siteForces) const;
    OverdampedMove& moveOf(Group& group) const;
    OverdampedScheme& schemeOf(Group& group) const;
    void restoreMemory(Group& group) const;
    bool differencesIterate(const Group& group, const SchemeTraits& scheme) const;
    double differenceOf(const Group& group, const SchemeTraits& scheme, double wanted) const;
    void setStart(Group& group, const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    void takeForces(Group& group, const BodySet& bodies, const FreeParticles& freeParticles) const;
    bool writePlaces(const Group& group, const std::vector<Pose>& places, BodySet& bodies,
                     std::vector<OpenMM::Vec3>& positions) const;
    std::string objection(const Group& group, const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    void setPoses(Group& group, const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    void scaleToZ(Group& group, const BodySet& bodies, const FreeParticles& freeParticles, bool inverse);
    void relaxMatrixFree(Group& group, double h, double kT, const BodySet& bodies, const FreeParticles& freeParticles);
    void relaxGroup(Group& group, double h, double kT, const NoiseStream& noise, BodySet& bodies,
                    const FreeParticles& freeParticles, const std::vector<OpenMM::Vec3>& positions,
                    std::vector<OpenMM::Vec3>& velocities);

    /** Groups are spread over threads where they cost more than waking these, about 1e-4 s (benchmarks/README.md). */
    static constexpr double worthThreads = 1e6, operationsOfConstantTensor = 1000;

    const MobilityForce force;
    const CustomRigidHIIntegrator::WallRejection wallRejection;
    CustomRigidHIIntegrator::Scheme overdampedScheme_ =
        CustomRigidHIIntegrator::EulerMaruyama;        // of the groups' schemes
    long long productsBefore = 0, matricesBefore = 0;  // of the fluids before this one in the Context
    std::vector<std::unique_ptr<Group>> groups;
    std::vector<Group*> coupledGroups;
    double operationsPerStep = 0;  // of these, roughly
    std::vector<std::vector<int>> particlesOfBodies;
    std::vector<int> groupOfBody, groupOfFree;  // free: by place in FreeParticles, -1: not seen
    PlatformLoops& loops;
};

}  // namespace RigidHIPlugin

#endif
