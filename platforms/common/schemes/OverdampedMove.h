#ifndef RIGIDHI_OVERDAMPED_MOVE_H_
#define RIGIDHI_OVERDAMPED_MOVE_H_

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "random/CounterNoise.h"
#include "rigid/BodyMobility.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/** What one step of a scheme without momenta is about. */
struct OverdampedStep {
    double h = 0, kT = 0;
    double difference = 0;  // setFiniteDifferenceStep(), in body lengths and radians
    NoiseStream noise;
    bool driftFactorScalesAll = false;  // setDriftCorrectorScaling(Whole)
    const DrivenFlow* flow = nullptr;   // null: none
};

/**
 * What the flow of the fluid in a step is made of, whose mean is that of the flow which moves the
 * bodies: shares of forces at poses, and so many times the model's random field. Where there is
 * none, forces that would make the particles' thermal slips take its place: they give the mean of a
 * random field with these slips.
 */
struct FlowOfStep {
    struct Share {
        double weight;
        std::vector<Pose> poses;
        Eigen::MatrixXd forces;  // where slips live: BodyMobility::flowSources()
        bool inFlow;             // whether they come from a solve in the driven flow
    };
    std::vector<Share> shares;
    double fieldWeight = 0, flowWeight = 1;  // of the random and the driven flow
    double solveWeight = 0;                  // of solves that give velocities of bodies
    /** @throws OpenMMException if solves and driven flow do not have the same weight: the scheme
     * recorded another velocity than it moved with, or none */
    void check(const std::string& scheme) const;
};

/**
 * One group of bodies on its way through a step without momenta: the moves that schemes are made
 * of.
 *
 * Schemes (OverdampedScheme.h) are written in these. Vectors are columns of a MatrixXd: wrenches
 * (force, torque about the origin) and twists (V, W) have six rows a body and three a free
 * particle, lab frame. Orientations move by rotations only: q <- exp(W t/2) q (Delong 2015, eq.
 * 13).
 */
class OverdampedMove {
public:
    typedef Eigen::MatrixXd Vectors;
    /** Which of the step's two independent sets of random numbers. */
    enum Draw { First, Second };

    explicit OverdampedMove(BodyMobility& mobility);

    // ---- The engine's side
    /** Where a step starts, to be set before, and where it is. */
    std::vector<Pose> start, present;
    void begin(const OverdampedStep& step);
    /** Record the flow of the step that begins, or (null) not. */
    void record(FlowOfStep* flowOfStep) { recorded = flowOfStep; }
    /** The model's random field, where the step has drawn it. */
    RandomField* getField() const { return slipsAreOfField ? field.get() : nullptr; }
    BodyMobility& getMobility() { return mobility; }
    long long randomNumbers = 0;  // of this step

    // ---- The schemes' side
    double h = 0, kT = 0;
    /** Forces and torques where they were evaluated last. */
    Vectors force;
    /** U = N F, or with slips N (F + K^T M^-1 s), at the present poses. */
    void solve(const Vectors& wrenches, Vectors& twists) { mobility.solve(wrenches, twists); }
    void solve(const Vectors& wrenches, const Vectors& slips, Vectors& twists) {
        mobility.solve(wrenches, slips, twists);
    }
    /** Keep the forces of a column of the last solve(), and begin another's iterations there, at
     * poses a step away at most. Within a step: nothing is carried to the next. */
    void keepForces(int column = 0) { mobility.keepForces(column); }
    void solveFromKept(const Vectors& wrenches, const Vectors& slips, Vectors& twists) {
        mobility.solveFromKept(wrenches, slips, twists);
    }
    /**
     * slips += those of the flow that users drive, at the present poses, in one of so many columns:
     * of a solve that gives velocities of bodies, not of one for directions. Where there is no flow
     * nothing is done; slips without rows are none so far.
     */
    void addFlow(Vectors& slips, int column = 0, int columns = 1);
    // The following say what the flow is that the scheme moves bodies with: for users who ask. They
    // do nothing in a step that nobody has asked about.
    /**
     * It has `weight` times what comes from the forces of the last solve, a column of it. The
     * weights of those that give velocities of bodies sum up to 1.
     *
     * @param givesVelocity  whether it does, and so has had addFlow(); if not, it is one for
     * directions
     */
    void recordSolve(double weight, int column = 0, bool givesVelocity = true);
    /** It has `weight` times the random flow whose slips the last thermalSlip() gave, at the
     * present poses. */
    void recordThermalSlip(double weight);
    /** It has kT times the change along the directions of what comes from the forces of
     * drawTractions(). */
    void recordTractions(double kT);
    /** All of it is multiplied by nu. */
    void recordFactor(double nu);
    /** N^(-1/2) W at the present poses: of covariance N^-1. */
    void thermalWrench(Draw draw, Vectors& wrench);
    /** Draw what thermalSlip() is made of, which then depends on poses only until the next drawing:
     * the model's random field, or W. */
    void drawForSlips(Draw draw);
    /** Whether drawForSlips() draws a random field of the model's, so that slips take no square
     * root. */
    bool slipsWillBeOfField() const { return mobility.slipsAreOfField(); }
    /** Of covariance M: the field's, or M^(1/2) W. */
    void thermalSlip(Vectors& slips);

    /** Whether div N is 0 or known without differences; then addKnownDrift() adds it. */
    bool driftIsKnown() const { return mobility.isUniform() || mobility.isDivergenceFree(); }
    /** Whether it is 0 while N changes with poses: spheres. What makes a drift by noise at other
     * poses is then to be left out. */
    bool driftIsZero() const { return !mobility.isUniform() && mobility.isDivergenceFree(); }
    /** U += factor div N, where that is known; recorded with its flow. Before the start is left. */
    void addKnownDrift(double factor, Vectors& twists);
    /**
     * Random directions for finite differences: W~ of unit covariance, whose displacements delta W~
     * are lengths through each body's length L, and which as wrenches are divided by it:
     * `directions` = (W~_t / L, W~_r).
     */
    void drawDirections();
    Vectors directions;
    /**
     * What the differences of K and M along the directions do to the blob forces lambda of the last
     * solve (its first column, of the directions as wrenches): forces -(K^T(Q+) - K^T(Q-)) lambda /
     * delta and slips (M(Q+) - M(Q-)) lambda / delta, Q+- = the start displaced by +-delta/2.
     */
    void drawTractions(Vectors& forces, Vectors& slips);
    /** (K(Q+) - K(Q-)) U / delta at the same Q+-. */
    void rigidSlipDifference(const Vectors& twists, Vectors& slips);
    /**
     * The poses that are `step` directions away from the start: R + step L W~_t, Rotate(q, step
     * W~_r). If the model has no mobility there but has one the other way, `step` changes its sign;
     * if neither, it is made smaller.
     * @throws OpenMMException if nothing helps
     */
    void displace(double& step, std::vector<Pose>& poses);
    /** Likewise along one coordinate (a row of twists) only. */
    void displaceAlong(int row, double& step, std::vector<Pose>& poses);
    /** The relative finite-difference step. */
    double differenceStep() const { return differenceStep_; }
    /** Each row's length: L for translations, 1 for rotations. */
    double lengthOfRow(int row) const { return lengths[row]; }
    int getNumRows() const { return mobility.getBodies().getNumRows(); }
    /** Do everything at the start, at the present poses, or at displaced ones from now on. */
    void atStart() { mobility.setPoses(start); }
    void atPresent() { mobility.setPoses(present); }
    void at(const std::vector<Pose>& poses) { mobility.setPoses(poses, true); }
    /** Move to Q^n + t U: Rotate(q, t W). */
    void goFromStart(double t, const Vectors& twists);
    /**
     * Whether divergenceOfField() is known, so that no differences are needed: slips are of the
     * model's random field, which is one flow.
     */
    bool knowsDivergence() const { return slipsAreOfField && mobility.divergenceIsOfField(); }
    /**
     * The divergence by the bodies' coordinates of the twists nearest to the field's slips, at the
     * present poses; of a field of unit temperature and time. The twists of a body depend on its
     * own pose only, so all bodies are displaced at once.
     */
    double divergenceOfField();
    /** What nu multiplies: everything, or the slips only. */
    bool driftFactorScalesAll() const { return driftFactorScalesAll_; }
    /** For the warning about its fluctuations. */
    void noteDriftFactor(double nu);
    double driftFactorSpread() const {
        return numDriftFactors == 0 ? 0 : std::sqrt(driftFactorSquares / numDriftFactors);
    }
    long long getNumDriftFactors() const { return numDriftFactors; }
    /** The twists nearest to slips. */
    void nearestTwists(const Vectors& slips, Vectors& twists) const {
        mobility.nearestTwists(slips, twists);
    }

private:
    /** The start displaced by half a step both ways, for a central difference; one-sided where only
     * one side is possible. */
    void displaceBothWays(double& step);
    void displaceBy(double step, int onlyRow, std::vector<Pose>& poses) const;
    void recordKnownDrift(double factor);
    bool isAccepted(const std::vector<Pose>& poses);
    [[noreturn]] void failToDisplace(const std::vector<Pose>& poses);
    void drawForBodies(uint32_t purpose, uint32_t freePurpose, Vectors& W);
    void drawForParticles(uint32_t purpose, Vectors& W);
    void drawNumbers(uint32_t purpose, uint32_t index, int count, double* numbers);

    BodyMobility& mobility;
    std::vector<double> lengths;  // of rows
    std::vector<Pose> forward, backward;
    double centralStep = 0;   // between these two
    Vectors lambdas, lambda;  // of all columns, of the first
    Vectors wrenchAtOtherEnd, slipAtOtherEnd;
    Vectors W, W_slip;
    std::unique_ptr<RandomField> field;
    bool slipsAreOfField = false;
    NoiseStream stream;
    double differenceStep_ = 0;
    bool driftFactorScalesAll_ = false;
    const DrivenFlow* flow = nullptr;
    FlowOfStep* recorded = nullptr;
    Vectors slipsOfFlow, recordedSlips;
    long long numDriftFactors = 0;
    double driftFactorSquares = 0;  // of nu - 1
};

}  // namespace RigidHIPlugin

#endif
