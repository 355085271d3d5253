#ifndef RIGIDHI_OVERDAMPED_MOVE_H_
#define RIGIDHI_OVERDAMPED_MOVE_H_

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "random/CounterNoise.h"
#include "rigid/BodyMobility.h"
#include "rigid/Joints.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/** The settings of one step of a scheme without momenta, and the driven flow. */
struct OverdampedStep {
    double h = 0, kT = 0;
    double difference = 0;  // setFiniteDifferenceStep(), in body lengths and radians
    NoiseStream noise;
    bool driftFactorScalesAll = false;  // setDriftCorrectorScaling(Whole)
    const DrivenFlow* flow = nullptr;   // null: none
    Eigen::VectorXd motorRates;         // of all motors of the integrator; empty: none
};

/**
 * The sources of the flow of the fluid in a step. The mean of this flow is the mean of the flow
 * that moves the bodies. The sources are shares of forces at poses, and a multiple of the model's
 * random field. If the model has no random field, forces that would cause the particles' thermal
 * slips (random surface velocities) take its place. They give the mean of a random field with these
 * slips.
 */
struct FlowOfStep {
    struct Share {
        double weight;
        std::vector<Pose> poses;
        Eigen::MatrixXd forces;  // where slips act: BodyFlow::sourcesOf()
        bool movesBodies;  // from a solve in the driven flow and with the slips of active bodies
    };
    std::vector<Share> shares;
    double fieldWeight = 0, flowWeight = 1;  // of the random and the driven flow
    double solveWeight = 0;                  // sum over solves that give velocities of bodies
    /**
     * @throws OpenMMException if the weights of the solves do not sum up to that of the driven
     *     flow: the scheme has not recorded the velocity with which it moved bodies
     */
    void check(const std::string& scheme) const;
};

/** The drift factors nu that a scheme has used. Their mean is 1. */
class DriftFactors {
public:
    void add(double nu) {
        number++;
        squares += (nu - 1) * (nu - 1);
    }
    long long size() const { return number; }
    /** The root of the mean of (nu - 1)^2. */
    double spread() const { return number == 0 ? 0 : std::sqrt(squares / number); }

private:
    long long number = 0;
    double squares = 0;
};

/**
 * One group of bodies during a step without momenta, and the moves of which schemes consist.
 *
 * Schemes (OverdampedScheme.h) call these moves. Vectors are columns of a MatrixXd. Wrenches
 * (force, torque about the origin) and twists (V, W) have six rows for a body and three for a free
 * particle, lab frame. Orientations move by rotations only: q <- exp(W t/2) q (Delong 2015, eq.
 * 13).
 */
class OverdampedMove {
public:
    using Vectors = Eigen::MatrixXd;
    /** Which of the step's two independent sets of random numbers. */
    enum Draw { First, Second };

    explicit OverdampedMove(BodyMobility& mobility);
    virtual ~OverdampedMove() {}

    // ---- The engine's side
    /**
     * The poses at the start of the step, which the caller sets before it, and the present poses.
     */
    std::vector<Pose> start, present;
    void begin(const OverdampedStep& step);
    /** What a step records for users. A null pointer leaves it out. */
    struct Recording {
        FlowOfStep* flow = nullptr;
        /**
         * The sum of the wrenches that hold fixed components, each solve with its weight. Rows of
         * free components are 0 up to the tolerance.
         */
        Vectors* holds = nullptr;
        /** The sum of the forces of joints, 4 x joints (Joints::forces()). */
        Vectors* jointForces = nullptr;
    };
    Recording recording;
    /**
     * Prescribe the velocities of fixed components from now on, at the present stage's time:
     * FreeMotion::motionOfFixed(). null: they are at rest.
     */
    void prescribe(const Vectors* velocitiesOfFixed) { prescribed = velocitiesOfFixed; }
    /** Set joints between the elements; null: none. Call this before begin(). */
    void setJoints(const Joints* jointsOfElements) { joints = jointsOfElements; }
    /** The model's random field, if the step has drawn one; else null. */
    RandomField* getField() const { return slipsAreOfField ? field.get() : nullptr; }
    BodyMobility& getMobility() { return mobility; }
    long long randomNumbers = 0;  // of this step

    // ---- The schemes' side
    double h = 0, kT = 0;
    /** The forces and torques that were evaluated last. */
    Vectors force;
    /**
     * One column of a solve, for velocities of bodies or for a direction, with its weight in the
     * velocities with which the step moves bodies. Its vectors must live until the solve.
     */
    class Column {
        friend class OverdampedMove;
        double weight;
        bool givesVelocity;
        const Vectors &wrench, &slips, &moreSlips;
        double axisFactor = 0;
        const Vectors* axisForces = nullptr;
        Column(double weight, bool givesVelocity, const Vectors& wrench, const Vectors& slips,
               const Vectors& moreSlips)
            : weight(weight), givesVelocity(givesVelocity), wrench(wrench), slips(slips),
              moreSlips(moreSlips) {}

    public:
        /**
         * Say that the wrench contains a multiple of drawAxisForces(). The holding forces, or a
         * joint, exert this multiple. Its part on fixed components counts as a part of the holding
         * wrench.
         */
        Column& including(double factor, const Vectors& forces) {
            axisFactor = factor;
            axisForces = &forces;
            return *this;
        }
    };
    /**
     * A column that gives velocities of bodies, N (F + K^T M^-1 s) at the present poses, with the
     * prescribed velocities of fixed components. The slips s are the sum of `slips`, the slips of
     * the flow that users drive, the slips of active bodies, and `moreSlips`. A vector without rows
     * stands for zeros.
     *
     * @param weight  of these velocities in the velocities of the step. The weights of a step sum
     *     up to 1; a predictor has 0
     */
    static Column velocity(double weight, const Vectors& wrench, const Vectors& slips = Vectors(),
                           const Vectors& moreSlips = Vectors()) {
        return Column(weight, true, wrench, slips, moreSlips);
    }
    /**
     * A column N F of a direction or of noise alone, without the driven flow and without the slips
     * of active bodies.
     *
     * @param weight  of N F in the velocities of the step; 0 if N F itself is not part of them
     */
    static Column direction(double weight, const Vectors& wrench) {
        return Column(weight, false, wrench, wrench, wrench);
    }
    /**
     * Solve the columns, and record the flow of their forces with their weights, for users who ask
     * for it.
     */
    void solve(const Column& column, Vectors& twists);
    void solve(const Column& first, const Column& second, Vectors& twists);
    /**
     * Keep the forces of a column of the last solve(), within the step. The iterations of
     * solveFromKept() begin at these forces, at poses that are at most a step away.
     */
    void keepForces(int column = 0) { mobility.keepForces(column); }
    void solveFromKept(const Column& column, Vectors& twists);
    // The following methods record the other parts of the flow with which the scheme moves bodies.
    // They do nothing unless somebody has asked for the flow of the step.
    /**
     * The flow contains `weight` times the random flow that belongs to the last thermalSlip(), at
     * the present poses.
     */
    void recordThermalSlip(double weight);
    /**
     * Take the flow of the blob forces of drawTractions(). The flow of the step contains kT times
     * the change of this flow along the directions.
     */
    void recordTractions(double kT);
    /** The factor nu multiplies the whole flow. */
    void recordFactor(double nu);
    /**
     * Where bodies go to the mid-point by nearestTwists(), the rotation of rods about their lines
     * adds a term to the holds. Remove this term: NullTwists::addDivergenceOfTurns().
     */
    void removeTurnsFromHolds();
    /** N^(-1/2) W at the present poses, of covariance N^-1. */
    void thermalWrench(Draw draw, Vectors& wrench);
    /**
     * Draw the random numbers of thermalSlip(): the model's random field, or W. Until the next
     * draw, thermalSlip() depends on poses only.
     */
    void drawForSlips(Draw draw);
    /**
     * Whether drawForSlips() draws a random field of the model, so that slips need no square root.
     */
    bool slipsWillBeOfField() const { return mobility.field().givesSlips(); }
    /** Slips of covariance M: the field's slips, or M^(1/2) W. */
    void thermalSlip(Vectors& slips);

    /** Whether div N is 0 or known without differences. If so, addKnownDrift() adds it. */
    bool driftIsKnown() const {
        if (joints) return false;
        return mobility.getBodies().isUniform() || mobility.getBodies().isDivergenceFree() ||
               mobility.getBodies().isImmobile();
    }
    /**
     * Whether div N is 0 although N changes with poses, as for spheres. A scheme then leaves out
     * noise at other poses, which would cause a drift.
     */
    bool driftIsZero() const {
        return !joints && !mobility.getBodies().isUniform() &&
               mobility.getBodies().isDivergenceFree();
    }
    /**
     * U += factor div N, where div N is known, and record the flow of this drift. Call this while
     * the bodies are at the start.
     */
    void addKnownDrift(double factor, Vectors& twists);
    /**
     * Draw random directions W~ of unit covariance for finite differences. Components that are
     * fixed in the lab frame get none, because N has no columns for them. With each body's length
     * L, translations are displaced by delta L W~_t. As wrenches the directions are divided by L:
     * `directions` = (W~_t / L, W~_r).
     */
    void drawDirections();
    Vectors directions;
    /**
     * Apply the differences of K and M along the directions to the blob forces lambda of the last
     * solve (its first column, with the directions as wrenches). Forces are -(K^T(Q+) - K^T(Q-))
     * lambda / delta and slips are (M(Q+) - M(Q-)) lambda / delta, where Q+- is the start displaced
     * by +-delta/2.
     *
     * @param noiseIsFrozen  whether the scheme uses thermal slips of the start at other poses too.
     *     The wrenches in slips of parts (SlipSpace) are then the same there, and cause no drift.
     */
    void drawTractions(Vectors& forces, Vectors& slips, bool noiseIsFrozen = false);
    /** (K(Q+) - K(Q-)) U / delta at the Q+- of drawTractions(). */
    void rigidSlipDifference(const Vectors& twists, Vectors& slips);
    // The following methods are for components that are fixed along axes that turn with their body,
    // and for joints: C U = b, C = C(Q). If a scheme applies its noise at other poses than its
    // mobility, it lacks a term of the drift, the mean of a force along these axes
    // (docs/theory/held_and_driven.md). Differences are along the directions.
    /** Whether the bodies have such components, or joints. */
    bool axesTurn() const {
        return joints || mobility.getBodies().getFreeMotion().turnsWithBodies();
    }
    /**
     * (C^T(Q+) - C^T(Q-)) mu / delta, where mu are the forces along the axes in the last solve,
     * which had the directions as its first column. Q+- are those of drawTractions(), or are chosen
     * here.
     */
    void drawAxisForces(Vectors& forces);
    /**
     * Add -factor (C(Q+) - C(Q-)) U / delta to the prescribed velocities, until the next stage.
     * Call this after drawAxisForces().
     */
    void prescribeAxisDifference(double factor, const Vectors& twists);
    /**
     * The poses that are `step` directions away from the start: R + step L W~_t, Rotate(q, step
     * W~_r). If the model has no mobility there, but has one in the opposite direction, `step`
     * changes its sign. If it has none in either direction, `step` becomes smaller.
     * @throws OpenMMException if no attempt succeeds
     */
    void displace(double& step, std::vector<Pose>& poses);
    /** The same displacement along one coordinate (a row of twists) only. */
    void displaceAlong(int row, double& step, std::vector<Pose>& poses);
    /** The relative finite-difference step. */
    double differenceStep() const { return differenceStep_; }
    /** Each row's length: L for translations, 1 for rotations. */
    double lengthOfRow(int row) const { return lengths[row]; }
    int getNumRows() const { return mobility.getBodies().getNumRows(); }
    /** Whether N may have a column for this row: FreeMotion::isFree(). */
    bool isFree(int row) const { return mobility.getBodies().getFreeMotion().isFree(row); }
    /**
     * From now on compute everything at the start, at the present poses, or at displaced poses.
     * Take differences before atPresent(): after it, iterations go to the tolerance itself, and
     * displace(), displaceAlong() and drawTractions() throw.
     */
    void atStart() {
        mobility.setPoses(start);
        responseIsKnown = false;
    }
    void atPresent() {
        mobility.setPoses(present);
        responseIsKnown = false;
        mobility.endDifferences();
        differencesHaveEnded = true;
    }
    void at(const std::vector<Pose>& poses) {
        mobility.setPoses(poses, true);
        responseIsKnown = false;
    }
    /**
     * Move to Q^n + t nu U: Rotate(q, t nu W). The factor nu does not multiply prescribed
     * velocities.
     */
    void goFromStart(double t, const Vectors& twists, double nu = 1);
    /** Add the prescribed velocities of fixed components at the start. */
    void addPrescribed(Vectors& twists);
    /**
     * twists += the twists nearest to a shear flow, if the box tilts with it, at the start; nothing
     * in other flows. Afterwards the mobility is at the start.
     */
    void addShear(Vectors& twists);
    /**
     * Whether divergenceOfField() is known, so that the scheme needs no differences. This is so
     * where slips come from a random field of the model that is one flow.
     */
    bool knowsDivergence() const { return slipsAreOfField && mobility.field().knowsDivergence(); }
    /**
     * The divergence, with respect to the bodies' coordinates, of the twists nearest to the field's
     * slips, at the present poses, for a field of unit temperature and time.
     */
    double divergenceOfField();
    /** Whether nu multiplies the whole step; otherwise it multiplies the slips only. */
    bool driftFactorScalesAll() const { return driftFactorScalesAll_; }
    /** The drift factors of all steps, for the warning about their fluctuations. */
    DriftFactors driftFactors;
    /** The twists nearest to slips. */
    void nearestTwists(const Vectors& slips, Vectors& twists) const {
        mobility.nearestTwists(slips, twists);
    }

protected:
    /** Draw random numbers of mean 0 and variance 1. Tests replace them. */
    virtual void drawNumbers(uint32_t purpose, uint32_t index, int count, double* numbers);

private:
    /**
     * Displace the start by half a step in both directions, for a central difference. If only one
     * side is possible, the difference is one-sided.
     */
    void displaceBothWays(double& step);
    void displaceBy(double step, int onlyRow, std::vector<Pose>& poses) const;
    /** The slips of a column; empty: none. */
    const Vectors& slipsOf(const Column& column);
    const Vectors& wrenchOf(const Column& column);
    /** Solve, and find the forces of joints, which act too. */
    void solveWithJoints(const Vectors& wrenches, const Vectors& slips, bool fromKept,
                         const Column* const* columns, Vectors& twists);
    void findResponse();
    /**
     * Finish the solve of a column: add prescribed velocities, and record the flow and the holds.
     */
    void finishSolve(const Column& solved, Vectors& twists, int column = 0);
    void recordSolve(const Column& solved, int column);
    void recordHold(const Column& solved, int column);
    /** Record `weight` times the flow of the forces of a column of the last solve. */
    void recordShare(double weight, int column, bool movesBodies);
    void recordKnownDrift(double factor);
    bool isAccepted(const std::vector<Pose>& poses);
    void requireDifferences(const char* method) const;
    [[noreturn]] void failToDisplace(const std::vector<Pose>& poses);
    void countField();
    void drawForBodies(uint32_t purpose, uint32_t freePurpose, Vectors& W, bool onlyFree = false);
    void drawForParticles(uint32_t purpose, Vectors& W);

    BodyMobility& mobility;
    std::vector<double> lengths;  // of rows
    std::vector<Pose> forward, backward;
    double centralStep = 0;   // between the two poses
    Vectors lambdas, lambda;  // of all columns; of the first
    Vectors wrenchAtOtherEnd, slipAtOtherEnd;
    Vectors W, W_slip;
    std::unique_ptr<RandomField> field;
    bool fieldIsCounted = false;
    bool slipsAreOfField = false;
    NoiseStream stream;
    double differenceStep_ = 0;
    bool differencesHaveEnded = false;
    bool driftFactorScalesAll_ = false;
    const DrivenFlow* flow = nullptr;
    /** The prescribed velocities at these poses, as twists. */
    const Vectors& findPrescribed(const std::vector<Pose>& at);
    const Vectors* prescribed = nullptr;
    Vectors prescribedWithAxes;
    const Joints* joints = nullptr;
    bool responseIsKnown = false;  // of joints, at the poses set last
    Eigen::VectorXd rightSides;    // of joints; empty: all 0
    Vectors C, N_CT, inverseOfCNC, mu, wrenchesWithJoints, twistsOfWrenches, forcesOfJoints;
    bool endsAreFound = false;   // of the difference along the present directions
    Vectors axisForcesOfFixed;   // of drawAxisForces(), without those of joints
    Vectors axisForcesOfJoints;  // of drawAxisForces(), in the form of Joints::forces()
    std::vector<Eigen::Matrix3d> turnsOfFixed;
    Vectors twistsOfFixed, scaledTwists, slipsOfFixed, forcesOfSolve, wrenchesOfSolve;
    Vectors slipsOfFlow, twistsOfFlow, slipsOfActive, slipsOfColumn, wrenchOfColumn, recordedSlips;
    Vectors wrenches, slips;  // of two columns
    const Vectors noSlips;
};

}  // namespace RigidHIPlugin

#endif
