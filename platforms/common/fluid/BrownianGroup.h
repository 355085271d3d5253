#ifndef RIGIDHI_BROWNIAN_GROUP_H_
#define RIGIDHI_BROWNIAN_GROUP_H_

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "fluid/BodiesAlone.h"
#include "fluid/GroupMembers.h"
#include "fluid/SavedStep.h"
#include "fluid/StepWatch.h"
#include "host/StepSettings.h"
#include "rigid/BodyMobilities.h"
#include "rigid/ErrorBudget.h"
#include "rigid/SlowedSpin.h"
#include "schemes/OverdampedSchemes.h"

namespace RigidHIPlugin {

/**
 * A group of bodies in a scheme without momenta: the mobility of its steps, the scheme with its
 * memory, and the progress of the present step. If a step leads to poses at which the model has no
 * mobility, only this group redoes the step.
 *
 * A step calls begin(), then runStage() until no stage is left, with reject() after a stage whose
 * poses are not accepted, and then end().
 */
class BrownianGroup {
public:
    using Scheme = CustomRigidHIIntegrator::Scheme;

    /**
     * @param mobility   of `members`, with the real spins, as for answers
     * @param tolerance  of iterations, as the user has set it
     */
    BrownianGroup(const GroupMembers& members, BodyMobility& mobility, BodiesAlone& alone,
                  double tolerance);

    // ---- Steps
    void begin(Scheme scheme);
    /** End the step. Its record becomes the last step, if steps are remembered. */
    void end();
    /** The number of completed stages of the present step, and of its earlier attempts. */
    int getStage() const { return stage; }
    uint32_t getAttempt() const { return attempt; }
    /** The surroundings that all groups share. */
    struct Surroundings {
        const DrivenFlow* flow;  // null: none
        const BoxVectors& box;
        bool stepIsRemembered;  // for users who ask for the flow of the fluid
        /** Of the stage, 6 for each body of the Context; null: nothing is prescribed. */
        const Eigen::MatrixXd* prescribed;
    };
    /**
     * Make what the steps of these settings need. Call this before runStage(), which may run in a
     * thread.
     */
    void prepare(const StepSettings& settings);
    /** Arithmetic operations of a stage, roughly, and of a step with a constant tensor. */
    double getOperations() const;
    static constexpr double operationsOfConstantTensor = 1000;
    /**
     * Run a stage, if it is this group's next one. The stage leads from the present poses of the
     * members to the poses where the next stage needs forces, or to the end of the step. If the
     * group is past this stage, its members return to the poses that the group has reached.
     * @return whether the stage was run
     */
    bool runStage(int stage, const StepSettings& settings, const Surroundings& around,
                  BodySet& bodies, const FreeParticles& freeParticles,
                  std::vector<OpenMM::Vec3>& positions);
    /** Of the last runStage(). */
    struct Outcome {
        bool isFinite = true;
        long long squareRoots = 0, iterations = 0, randomNumbers = 0;
    };
    const Outcome& getOutcome() const { return outcome; }
    /** Begin the step anew, with other random numbers. */
    void reject();
    /** The number of steps so far, and of rejected attempts. */
    long long getNumSteps() const { return numSteps; }
    long long getNumRejections() const { return numRejections; }
    /** Move the members to the poses where the forces of a stage were evaluated. */
    void showStage(int stage, BodySet& bodies, std::vector<OpenMM::Vec3>& positions) const;

    // ---- The scheme's memory between steps (OverdampedScheme::memory())
    std::vector<Eigen::MatrixXd*> getMemory() const;
    void restoreMemory();
    void forgetMemory();
    Scheme getScheme() const { return kind; }

    // ---- The last step, and the data to repeat it
    const LastStep& getLastStep() const { return last; }
    void setLastStep(const LastStep& step) { last = step; }
    void forgetLastStep() { last.isKnown = false; }
    /**
     * The mobility for a scheme's steps with the value 2 kT h; with 0, the mobility with the real
     * spins.
     */
    BodyMobility& mobilityFor(double doubleEnergy, Scheme scheme);
    /** The mobility that mobilityFor() chose last. */
    BodyMobility& getMobility() const { return *mobility; }
    /** Give the step's mobility the errors of the step. */
    void setErrors(const SchemeTraits& traits, const OverdampedStep& step) {
        mobility->setErrors(errorsOf(traits, step.kT, step.difference));
    }
    /** The forces last gathered, at the present poses of the members. */
    const Eigen::MatrixXd& readForces(const BodySet& bodies, const FreeParticles& freeParticles);

    // ---- Wrenches that hold fixed components
    /** The wrenches that held the elements in the last step; null before a step. */
    const Eigen::MatrixXd* getHolds() const { return holdsAreKnown ? &lastHolds : nullptr; }
    void setHolds(const Eigen::MatrixXd& holds) {
        lastHolds = holds;
        holdsAreKnown = true;
    }
    void forgetHolds() { holdsAreKnown = false; }

    // ---- Joints
    /**
     * Joints between the elements; null: none.
     *
     * @param tolerance  the largest violation that steps leave, nm
     * @param misfit     the largest violation with which steps begin, nm, or `tolerance` if this is
     *     larger
     */
    void setJoints(const Joints* jointsOfElements, double tolerance, double misfit) {
        joints = jointsOfElements;
        watch.setHasJoints(joints != nullptr);
        jointTolerance = tolerance;
        jointMisfit = std::max(tolerance, misfit);
    }
    const Joints* getJoints() const { return joints; }
    /** The rates of all motors of the Context from the next step on. */
    void setMotorRates(const std::vector<HingeMotorDefinition>& motors) {
        motorRates.resize(motors.size());
        for (size_t m = 0; m < motors.size(); m++) motorRates[m] = motors[m].rate;
    }
    const Eigen::VectorXd& getMotorRates() const { return motorRates; }
    /** Of the last step, as Joints::forces(); empty before a step. */
    const Eigen::MatrixXd& getJointForces() const { return lastJointForces; }

    // ---- Drift and differences
    enum class Drift { Differenced, Known, Zero, ZeroOfSpheres };
    Drift getDrift();
    /**
     * The errors of a scheme's steps, up to the last difference.
     *
     * @param difference  the finite-difference step, as differenceOf() gives it
     */
    ErrorBudget errorsOf(const SchemeTraits& traits, double kT, double difference);
    /**
     * The finite-difference step: the wanted one, or for 0 one that fits the errors of the
     * differenced results.
     */
    double differenceOf(const SchemeTraits& traits, double wanted);
    /** The root mean square of nu - 1 over steps so far; 0 before enough steps. */
    double getDriftFactorSpread() const;

    // ---- Spins that a step does not resolve
    /** The rotation of each element in a scheme's steps with the value 2 kT h. */
    const std::vector<BodyRotation>& findRotations(double doubleEnergy, Scheme scheme);
    /** Whether forces have kept turning an element whose spin is slowed, or any such element. */
    bool isDriven(int element) const;
    bool drivesSlowedSpins() const;
    /** Whether the steps so far resolve forces, and the motion that is not random. */
    const StepWatch& getWatch() const { return watch; }
    void interruptWatch() { watch.interrupt(); }

    MobilityCosts getCostsOfSlowed() const;
    void setBox(const BoxVectors& box);

private:
    /** The bodies with slowed spins. */
    struct SlowedBodies {
        SlowedBodies(const CoupledBodies& real, const std::vector<SlowedSpin>& spins,
                     double tolerance)
            : bodies(real, spins), mobilities(bodies, tolerance) {}
        CoupledBodies bodies;
        BodyMobilities mobilities;
    };
    /**
     * How far forces have turned a slowed body about its fastest axis, and the variance of the turn
     * by noise. If forces have a potential, both turns have the same size, because the body does
     * not keep turning (docs/theory/details_of_steps.md).
     */
    struct DrivenSpin {
        double turn = 0, variance = 0;  // rad, rad^2
        long long steps = 0;
    };
    OverdampedMove& theMove();
    Differencing differencing(const SchemeTraits& traits);
    OverdampedScheme& theScheme();
    void startStep(const StepSettings& settings, const Surroundings& around, const BodySet& bodies,
                   const std::vector<OpenMM::Vec3>& positions);
    void noteDrivenSpins(double h, double kT);

    const GroupMembers& members;
    const CoupledBodies& bodies;
    BodyMobility* const realMobility;
    BodiesAlone& alone;
    const double tolerance;

    BodyMobility* mobility;  // of the step: with the real spins or with slowed ones
    std::pair<double, Scheme> stepOfMobility = {-1, {}};  // 2 kT h, and the scheme
    std::unique_ptr<OverdampedMove> move;                 // made at the first step
    std::unique_ptr<OverdampedScheme> scheme;
    Scheme kind = CustomRigidHIIntegrator::EulerMaruyama;  // of the scheme
    std::vector<Eigen::MatrixXd> memoryAtStart;
    LastStep present, last;  // the record of the present step; the last whole step
    bool presentIsRemembered = false;
    Eigen::MatrixXd prescribed;               // of this stage, rows of the elements
    Eigen::MatrixXd presentHolds, lastHolds;  // where some component is fixed
    bool holdsAreKnown = false;
    const Joints* joints = nullptr;
    double jointTolerance = 0, jointMisfit = 0;
    Eigen::MatrixXd presentJointForces, lastJointForces;
    Eigen::VectorXd motorRates, anglesOfMotors;  // of the Context; of joints, where the step ends
    std::vector<Eigen::MatrixXd> ownMobilities;  // of elements, in their frames, for joints
    int stage = 0;
    uint32_t attempt = 0;
    long long numSteps = 0, numRejections = 0;  // so far
    Outcome outcome;
    std::vector<std::vector<Pose>> placesOfForces;  // where the forces of each stage are evaluated

    std::vector<BodyRotation> rotations;  // of the elements
    std::pair<double, Scheme> stepOfRotations = {-1, {}};
    std::vector<DrivenSpin> drivenSpins;  // of the elements
    StepWatch watch;
    Eigen::MatrixXd velocitiesOfFalls;
    std::unique_ptr<SlowedBodies> slowed;
    std::pair<double, Scheme> stepOfSlowed = {-1, {}};
    MobilityCosts costsOfFormerSlowed;
};

}  // namespace RigidHIPlugin

#endif
