#ifndef RIGIDHI_CONSTANT_MOBILITY_H_
#define RIGIDHI_CONSTANT_MOBILITY_H_

#include "linearalgebra/CholeskyFactor.h"
#include "rigid/BodyMobility.h"
#include "rigid/FrictionFactor.h"

namespace RigidHIPlugin {

/**
 * The mobility of a body alone in a uniform fluid. The tensor, the body's own or the model's, is
 * computed once in the body's frame, and turns with the body. Where some components are fixed, N_c
 * is computed from the tensor at each pose.
 */
class ConstantMobility : public BodyMobility {
public:
    explicit ConstantMobility(const CoupledBodies& bodies);
    Way getWay() const override { return Constant; }
    void setPoses(const std::vector<Pose>& poses, bool nearby = false) override;
    using BodyMobility::solve;
    void solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) override;
    void getBlobForces(MatrixXd& lambda) override { lambda = wrenchesOfSolve; }
    void multiplyNearby(const std::vector<Pose>& poses, const MatrixXd& lambda,
                        MatrixXd& slips) override;
    void thermalWrench(const MatrixXd& W, MatrixXd& wrench) override;
    void thermalSlip(const MatrixXd& W, MatrixXd& slips) override;
    void forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) override {
        thermalWrench(W, forces);
    }
    // Slips belong to the body, and the inverse mobility is the friction.
    void forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) override {
        forces = friction() * slips;
    }
    Eigen::Vector3d uniformDivergence() const override;
    const MatrixXd& mobility() override;
    const MatrixXd& friction() override;
    void multiply(const MatrixXd& wrenches, MatrixXd& twists,
                  const Accuracy& accuracy = Accuracy()) override;

protected:
    const std::vector<Eigen::Matrix3d>& getTurns() const override { return turns; }
    const std::vector<Pose>& getPoses() const override { return poses; }
    void forceFreeTwists(const DrivenFlow* flow, const MatrixXd& slips, MatrixXd& twists) override;
    void particleForces(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& forces) override;
    BodiesAt& particlesHere() override;

private:
    const NullTwists& nullTwistsOfBlobs();
    FrictionFactor& factorHere();
    OwnTensors::Matrix6d mobility_body, friction_body;
    CholeskyFactor factor_body;  // of the friction, lifted
    const bool isFixed;          // some component is
    FrictionFactor factor;       // at the poses, where some component is fixed
    bool isFactorised = false;
    std::vector<Pose> poses;
    std::vector<Eigen::Matrix3d> turns, turnsThere;
    BodiesAt particles;  // needed by applyToParticles() only
    MatrixXd N, xi, wrenchesOfSolve, thermal;
    MatrixXd forceFree_body, slips_body,
        twist_body;               // of forceFreeTwists(); computed when first needed
    NullTwists lineOfBlobs{{0}};  // likewise; of the blobs of a body with an own tensor
};

}  // namespace RigidHIPlugin

#endif
