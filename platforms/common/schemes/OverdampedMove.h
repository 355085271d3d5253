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

/** The settings of one step of a scheme without momenta, and the flow that it is in. */
struct OverdampedStep {
    double h = 0, kT = 0;
    double difference = 0;  // setFiniteDifferenceStep(), in body lengths and radians
    NoiseStream noise;
    bool driftFactorScalesAll = false;  // setDriftCorrectorScaling(Whole)
    const DrivenFlow* flow = nullptr;   // null: none
    Eigen::VectorXd motorRates;         // of all motors of the integrator; empty: none
};

/**
 * The sources of the flow of the fluid in a step. The mean of this flow is that of the flow which
 * moves the bodies. The sources are shares of forces at poses, and a multiple of the model's random
 * field. A model without a random field has, in its place, forces that would make the particles'
 * thermal slips (random surface velocities). They give the mean of a random field with these slips.
 */
struct FlowOfStep {
    struct Share {
        double weight;
        std::vector<Pose> poses;
        Eigen::MatrixXd forces;  // where slips act: BodyMobility::flowSources()
        bool movesBodies;  // of a solve in the driven flow and with the slips of active bodies
    };
    std::vector<Share> shares;
    double fieldWeight = 0, flowWeight = 1;  // of the random and the driven flow
    double solveWeight = 0;                  // sum over solves that give velocities of bodies
    /**
     * @throws OpenMMException if solves and driven flow do not have the same weight: the scheme
     *     recorded another velocity than the one it moved with, or none
     */
    void check(const std::string& scheme) const;
};

/**
 * One group of bodies on its way through a step without momenta. The members are the moves that
 * schemes are made of.
 *
 * Schemes (OverdampedScheme.h) are written in these moves. Vectors are columns of a MatrixXd.
 * Wrenches (force, torque about the origin) and twists (V, W) have six rows a body and three a free
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
    /** Where a step starts, to be set before the step, and where the bodies are at present. */
    std::vector<Pose> start, present;
    void begin(const OverdampedStep& step);
    /** Record the flow of the step that begins in flowOfStep; null: do not record. */
    void record(FlowOfStep* flowOfStep) { recorded = flowOfStep; }
    /**
     * Prescribe the velocities of fixed components from now on, at the present stage's time:
     * FreeMotion::motionOfFixed(). null: they are at rest.
     */
    void prescribe(const Vectors* velocitiesOfFixed) { prescribed = velocitiesOfFixed; }
    /** Joints between the elements; null: none. To be set before begin(). */
    void setJoints(const Joints* jointsOfElements) { joints = jointsOfElements; }
    /** Add up the forces of joints in the step, 4 x joints (Joints::forces()); null: do not. */
    void recordJointForces(Vectors* forces) { jointForces = forces; }
    /**
     * Add up in `holds` the wrenches that hold fixed components in the step, of whose mean each
     * solve has its weight; null: do not. Rows of free components are 0 up to the tolerance.
     */
    void recordHolds(Vectors* holdsOfStep) { holds = holdsOfStep; }
    /** The model's random field, where the step has drawn one. */
    RandomField* getField() const { return slipsAreOfField ? field.get() : nullptr; }
    BodyMobility& getMobility() { return mobility; }
    long long randomNumbers = 0;  // of this step

    // ---- The schemes' side
    double h = 0, kT = 0;
    /** Forces and torques where they were evaluated last. */
    Vectors force;
    /**
     * One column of a solve, which is for velocities of bodies or for a direction, and its weight
     * in the velocities with which the step moves bodies. Its vectors must live until it is solved.
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
         * Note that the wrench has a multiple of drawAxisForces(). What holds the body, or a joint,
         * exerts it. The part of fixed components counts as a part of the wrench that holds.
         */
        Column& including(double factor, const Vectors& forces) {
            axisFactor = factor;
            axisForces = &forces;
            return *this;
        }
    };
    /**
     * A column that gives velocities of bodies, N (F + K^T M^-1 s) at the present poses, with the
     * prescribed velocities of fixed components. The slips s are the sum of `slips`, of those of
     * the flow that users drive and of active bodies, and of `moreSlips`. A vector without rows
     * stands for zeros.
     *
     * @param weight  of these velocities in those of the step; the weights of a step sum up to 1. 0
     *     for a predictor
     */
    static Column velocity(double weight, const Vectors& wrench, const Vectors& slips = Vectors(),
                           const Vectors& moreSlips = Vectors()) {
        return Column(weight, true, wrench, slips, moreSlips);
    }
    /**
     * A column N F of a direction or of noise alone, which the driven flow and the slips of active
     * bodies are no part of.
     *
     * @param weight  of N F in the velocities of the step; 0 where it is no part of them by itself
     */
    static Column direction(double weight, const Vectors& wrench) {
        return Column(weight, false, wrench, wrench, wrench);
    }
    /**
     * Solve the columns, and record the flow of their forces, by their weights, for users who ask
     * for it.
     */
    void solve(const Column& column, Vectors& twists);
    void solve(const Column& first, const Column& second, Vectors& twists);
    /**
     * Keep the forces of a column of the last solve(). The iterations of solveFromKept() begin at
     * these forces, at poses a step away at most. The forces are kept within a step only.
     */
    void keepForces(int column = 0) { mobility.keepForces(column); }
    void solveFromKept(const Column& column, Vectors& twists);
    // The following methods record what else is in the flow with which the scheme moves bodies.
    // They do nothing in a step whose flow nobody has asked for.
    /**
     * The flow has `weight` times the random flow whose slips the last thermalSlip() gave, at the
     * present poses.
     */
    void recordThermalSlip(double weight);
    /**
     * The flow has kT times the change along the directions of the flow of the forces of
     * drawTractions().
     */
    void recordTractions(double kT);
    /** The whole flow is multiplied by nu. */
    void recordFactor(double nu);
    /**
     * Remove from the holds what the rotation of rods about their lines adds to them where bodies
     * go to the mid-point by nearestTwists(): NullTwists::addDivergenceOfTurns().
     */
    void removeTurnsFromHolds();
    /** N^(-1/2) W at the present poses, of covariance N^-1. */
    void thermalWrench(Draw draw, Vectors& wrench);
    /**
     * Draw the random numbers of thermalSlip(): the model's random field, or W. Until the next
     * drawing thermalSlip() depends on poses only.
     */
    void drawForSlips(Draw draw);
    /**
     * Whether drawForSlips() draws a random field of the model, so that slips take no square root.
     */
    bool slipsWillBeOfField() const { return mobility.slipsAreOfField(); }
    /** Slips of covariance M: those of the field, or M^(1/2) W. */
    void thermalSlip(Vectors& slips);

    /** Whether div N is 0 or known without differences. If so, addKnownDrift() adds it. */
    bool driftIsKnown() const {
        if (joints) return false;
        return mobility.isUniform() || mobility.isDivergenceFree() || mobility.isImmobile();
    }
    /**
     * Whether div N is 0 while N changes with poses, as for spheres. A scheme then leaves out noise
     * at other poses that would make a drift.
     */
    bool driftIsZero() const {
        return !joints && !mobility.isUniform() && mobility.isDivergenceFree();
    }
    /**
     * U += factor div N, where div N is known; the flow of this drift is recorded. To be called
     * before the start is left.
     */
    void addKnownDrift(double factor, Vectors& twists);
    /**
     * Draw random directions W~ of unit covariance for finite differences. Fixed components in the
     * lab frame have none, because N has no columns for them. Displacements delta W~
     * are turned into lengths by each body's length L. As wrenches the directions are divided by
     * it: `directions` = (W~_t / L, W~_r).
     */
    void drawDirections();
    Vectors directions;
    /**
     * Compute how the differences of K and M along the directions act on the blob forces lambda of
     * the last solve (its first column, for the directions as wrenches). Forces are -(K^T(Q+) -
     * K^T(Q-)) lambda / delta and slips are (M(Q+) - M(Q-)) lambda / delta, where Q+- is the start
     * displaced by +-delta/2.
     *
     * @param noiseIsFrozen  whether thermal slips of the start are taken at other poses too. What
     *     slips of parts (SlipSpace) hold of wrenches is then the same there, and makes no drift.
     */
    void drawTractions(Vectors& forces, Vectors& slips, bool noiseIsFrozen = false);
    /** (K(Q+) - K(Q-)) U / delta at the Q+- of drawTractions(). */
    void rigidSlipDifference(const Vectors& twists, Vectors& slips);
    // Components that are fixed along axes which turn with their body, and joints: C U = b, C =
    // C(Q). Schemes whose noise acts at other poses than their mobility lack a term of the drift,
    // which is the mean of a force along these axes (docs/theory/held_and_driven.md). Differences
    // are along the directions.
    /** Whether there are such components, or joints. */
    bool axesTurn() const {
        return joints || mobility.getBodies().getFreeMotion().turnsWithBodies();
    }
    /**
     * (C^T(Q+) - C^T(Q-)) mu / delta, where mu are the forces along the axes in the last solve,
     * whose first column was for the directions. Q+- are those of drawTractions(), or are found.
     */
    void drawAxisForces(Vectors& forces);
    /**
     * Add -factor (C(Q+) - C(Q-)) U / delta to the prescribed velocities, until the next stage. To
     * be called after drawAxisForces().
     */
    void prescribeAxisDifference(double factor, const Vectors& twists);
    /**
     * The poses that are `step` directions away from the start: R + step L W~_t, Rotate(q, step
     * W~_r). If the model has no mobility there but has one the other way, `step` changes its sign.
     * If it has none either way, `step` is made smaller.
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
     * From now on everything is computed at the start, at the present poses, or at displaced ones.
     * Differences are taken before atPresent(): after it, iterations go to the tolerance itself,
     * and displace(), displaceAlong() and drawTractions() throw.
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
     * twists += the twists that are nearest to a shear, whose box tilts, at the start; nothing in
     * other flows. The mobility is at the start afterwards.
     */
    void addShear(Vectors& twists);
    /**
     * Whether divergenceOfField() is known, so that no differences are needed. It is where slips
     * are of the model's random field, which is one flow.
     */
    bool knowsDivergence() const { return slipsAreOfField && mobility.divergenceIsOfField(); }
    /**
     * The divergence, by the bodies' coordinates, of the twists nearest to the field's slips, at
     * the present poses, for a field of unit temperature and time. The twists of a body depend on
     * its own pose only, so that all bodies are displaced at once.
     */
    double divergenceOfField();
    /** Whether nu multiplies the whole step; otherwise it multiplies the slips only. */
    bool driftFactorScalesAll() const { return driftFactorScalesAll_; }
    /** Note a drift factor, for the warning about its fluctuations. */
    void noteDriftFactor(double nu);
    double driftFactorSpread() const {
        return numDriftFactors == 0 ? 0 : std::sqrt(driftFactorSquares / numDriftFactors);
    }
    long long getNumDriftFactors() const { return numDriftFactors; }
    /** The twists nearest to slips. */
    void nearestTwists(const Vectors& slips, Vectors& twists) const {
        mobility.nearestTwists(slips, twists);
    }

protected:
    /** Draw random numbers of mean 0 and variance 1. Tests replace them. */
    virtual void drawNumbers(uint32_t purpose, uint32_t index, int count, double* numbers);

private:
    /**
     * Displace the start by half a step both ways, for a central difference. It is one-sided where
     * only one side is possible.
     */
    void displaceBothWays(double& step);
    void displaceBy(double step, int onlyRow, std::vector<Pose>& poses) const;
    /** The slips of a column; empty: none. */
    const Vectors& slipsOf(const Column& column);
    const Vectors& wrenchOf(const Column& column);
    /** Solve, with the forces of joints, which are then known. */
    void solveWithJoints(const Vectors& wrenches, const Vectors& slips, bool fromKept,
                         const Column* const* columns, Vectors& twists);
    void findResponse();
    /** What follows a solve of a column: prescribed velocities, the flow, and holds. */
    void finishSolve(const Column& solved, Vectors& twists, int column = 0);
    void recordSolve(const Column& solved, int column);
    void recordHold(const Column& solved, int column);
    /** The flow has `weight` times the flow of the forces of a column of the last solve. */
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
    FlowOfStep* recorded = nullptr;
    /** The prescribed velocities at these poses, as twists. */
    const Vectors& findPrescribed(const std::vector<Pose>& at);
    const Vectors* prescribed = nullptr;
    Vectors prescribedWithAxes;
    const Joints* joints = nullptr;
    Vectors* jointForces = nullptr;
    bool responseIsKnown = false;  // of joints, at the poses set last
    Eigen::VectorXd rightSides;    // of joints; empty: all 0
    Vectors C, N_CT, inverseOfCNC, mu, wrenchesWithJoints, twistsOfWrenches, forcesOfJoints;
    bool endsAreFound = false;   // of the difference along the present directions
    Vectors axisForcesOfFixed;   // of drawAxisForces(), without those of joints
    Vectors axisForcesOfJoints;  // of drawAxisForces(), in the form of Joints::forces()
    std::vector<Eigen::Matrix3d> turnsOfFixed;
    Vectors* holds = nullptr;
    Vectors twistsOfFixed, scaledTwists, slipsOfFixed, forcesOfSolve, wrenchesOfSolve;
    Vectors slipsOfFlow, twistsOfFlow, slipsOfActive, slipsOfColumn, wrenchOfColumn, recordedSlips;
    Vectors wrenches, slips;  // of two columns
    const Vectors noSlips;
    long long numDriftFactors = 0;
    double driftFactorSquares = 0;  // of nu - 1
};

}  // namespace RigidHIPlugin

#endif
