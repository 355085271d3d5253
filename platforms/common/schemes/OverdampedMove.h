#ifndef RIGIDHI_OVERDAMPED_MOVE_H_
#define RIGIDHI_OVERDAMPED_MOVE_H_

#include <Eigen/Core>
#include <vector>

#include "mobility/MobilityProblem.h"
#include "random/CounterNoise.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/** What one step of a scheme without momenta is about. */
struct OverdampedStep {
    double h = 0, kT = 0;
    double difference = 0;  // setFiniteDifferenceStep(), in body lengths and radians
    NoiseStream noise;
};

/**
 * One group of bodies on its way through a step without momenta: the moves that schemes are made of.
 *
 * Schemes (OverdampedScheme.h) are written in these. Vectors are columns of a MatrixXd: wrenches (force, torque about the origin) and twists (V, W) have six rows a
 * body and three a free particle, lab frame. Orientations move by rotations only: q <- exp(W t/2) q (Delong 2015, eq. 13).
 */
class OverdampedMove {
public:
    typedef Eigen::MatrixXd Vectors;
    /** Which of the step's two independent sets of random numbers. */
    enum Draw { First, Second };

    /** @param tolerance  relative, of the matrix-free way */
    OverdampedMove(BodyMobility& bodies, bool matrixFree, double tolerance);

    // ---- The engine's side
    /** Where a step starts, to be set before, and where it is. */
    std::vector<Pose> start, present;
    void begin(const OverdampedStep& step);
    MobilityProblem& getProblem() { return problem; }
    long long randomNumbers = 0;  // of this step

    // ---- The schemes' side
    double h = 0, kT = 0;
    /** Forces and torques where they were evaluated last. */
    Vectors force;
    /** U = N F, or with slips N (F + K^T M^-1 s), at the present poses. */
    void solve(const Vectors& wrenches, Vectors& twists) { problem.solve(wrenches, twists); }
    void solve(const Vectors& wrenches, const Vectors& slips, Vectors& twists) {
        problem.solve(wrenches, slips, twists);
    }
    /** N^(-1/2) W at the present poses: of covariance N^-1. */
    void thermalWrench(Draw draw, Vectors& wrench);
    /** Draw W of thermalSlip(), which then depends on poses only until the next drawing. */
    void drawForSlips(Draw draw);
    /** M^(1/2) W: of covariance M. */
    void thermalSlip(Vectors& slips) { problem.thermalSlip(W_slip, slips); }

    /** Whether div N is 0 or known without differences; then addKnownDrift() adds it. */
    bool driftIsKnown() const { return problem.isUniform() || problem.isDivergenceFree(); }
    /** Whether it is 0 while N changes with poses: spheres. What makes a drift by noise at other poses is then to be left out. */
    bool driftIsZero() const { return !problem.isUniform() && problem.isDivergenceFree(); }
    /** U += factor div N, where that is known. */
    void addKnownDrift(double factor, Vectors& twists) const;
    /**
     * Random directions for finite differences: W~ of unit covariance, whose displacements delta W~ are lengths through each body's
     * length L, and which as wrenches are divided by it: `directions` = (W~_t / L, W~_r).
     */
    void drawDirections();
    Vectors directions;
    /**
     * What the differences of K and M along the directions do to the blob forces lambda of the last solve (its first column, of the
     * directions as wrenches): forces -(K^T(Q+) - K^T(Q-)) lambda / delta and slips (M(Q+) - M(Q-)) lambda / delta, Q+- = the start
     * displaced by +-delta/2.
     */
    void drawTractions(Vectors& forces, Vectors& slips);
    /** (K(Q+) - K(Q-)) U / delta at the same Q+-. */
    void rigidSlipDifference(const Vectors& twists, Vectors& slips);
    /**
     * The poses that are `step` directions away from the start: R + step L W~_t, Rotate(q, step W~_r). If the model has no mobility
     * there but has one the other way, `step` changes its sign; if neither, it is made smaller.
     * @throws OpenMMException if nothing helps
     */
    void displace(double& step, std::vector<Pose>& poses) const;
    /** Likewise along one coordinate (a row of twists) only. */
    void displaceAlong(int row, double& step, std::vector<Pose>& poses) const;
    /** The relative finite-difference step. */
    double differenceStep() const { return differenceStep_; }
    /** Each row's length: L for translations, 1 for rotations. */
    double lengthOfRow(int row) const { return lengths[row]; }
    int getNumRows() const { return problem.getNumRows(); }
    /** Do everything at the start, at the present poses, or at displaced ones from now on. */
    void atStart() { problem.setPoses(start); }
    void atPresent() { problem.setPoses(present); }
    void at(const std::vector<Pose>& poses) { problem.setPoses(poses, true); }
    /** Move to Q^n + t U: Rotate(q, t W). */
    void goFromStart(double t, const Vectors& twists);
    /** The twists nearest to slips. */
    void nearestTwists(const Vectors& slips, Vectors& twists) const { problem.nearestTwists(slips, twists); }

private:
    /** The start displaced by half a step both ways, for a central difference; one-sided where only one side is possible. */
    void displaceBothWays(double& step);
    void displaceBy(double step, int onlyRow, std::vector<Pose>& poses) const;
    bool isAccepted(const std::vector<Pose>& poses) const;
    [[noreturn]] void failToDisplace(const std::vector<Pose>& poses) const;
    void drawForBodies(uint32_t purpose, uint32_t freePurpose, Vectors& W);
    void drawForParticles(uint32_t purpose, Vectors& W);
    void drawNumbers(uint32_t purpose, uint32_t index, int count, double* numbers);

    MobilityProblem problem;
    std::vector<double> lengths;  // of rows
    std::vector<Pose> forward, backward;
    double centralStep = 0;  // between these two
    Vectors lambda, atOtherEnd;
    Vectors W, W_slip;
    NoiseStream stream;
    double differenceStep_ = 0;
};

}  // namespace RigidHIPlugin

#endif
