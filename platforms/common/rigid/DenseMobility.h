#ifndef RIGIDHI_DENSE_MOBILITY_H_
#define RIGIDHI_DENSE_MOBILITY_H_

#include "rigid/BodyMobility.h"
#include "rigid/FrictionFactor.h"
#include "rigid/ParticleFactor.h"

namespace RigidHIPlugin {

/**
 * The mobility by matrices: Cholesky's factors of M and of the friction K^T M^-1 K. Where slips
 * belong to bodies, only the friction is factorised; where K = 1, only M, unless some component is
 * fixed. Factors are computed once for a configuration, when first needed; the part of held bodies
 * is computed again only if these bodies have moved.
 *
 * Where slips belong to bodies, K = 1 and N of all bodies stands for M.
 */
class DenseMobility : public BodyMobility {
public:
    explicit DenseMobility(const CoupledBodies& bodies);
    Way getWay() const override { return Dense; }
    void setPoses(const std::vector<Pose>& poses, bool nearby = false) override;
    using BodyMobility::solve;
    void solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) override;
    void getBlobForces(MatrixXd& lambda) override;
    void multiplyNearby(const std::vector<Pose>& poses, const MatrixXd& lambda,
                        MatrixXd& slips) override;
    void thermalWrench(const MatrixXd& W, MatrixXd& wrench) override;
    void thermalSlip(const MatrixXd& W, MatrixXd& slips) override;
    void forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) override;
    void forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) override;
    const MatrixXd& mobility() override;
    const MatrixXd& friction() override;
    void multiply(const MatrixXd& wrenches, MatrixXd& twists,
                  const Accuracy& accuracy = Accuracy()) override;

protected:
    const std::vector<Eigen::Matrix3d>& getTurns() const override { return here.getTurns(); }
    const std::vector<Pose>& getPoses() const override { return here.getPoses(); }
    BodiesAt& particlesHere() override { return here; }

private:
    void factoriseParticles();
    void factorise();
    void factoriseFriction();

    const bool slipsAreTwists;  // K = 1, or no M exists; and nothing is fixed
    const bool isFixed;         // some component is
    BodiesAt here, elsewhere;
    bool particlesAreFactorised = false, isFactorised = false, mobilityIsKnown = false,
         frictionIsKnown = false;
    ParticleFactor particleFactor;
    const CholeskyFactor& M;
    const MatrixXd& LK;
    FrictionFactor xi;
    MatrixXd lifted;            // the friction before factorisation
    MatrixXd N, frictionOfAll;  // where some component is fixed
    /** Arrays of a solve(), kept for each number of columns. */
    struct Columns {
        MatrixXd halfSlips, halfForces, wrenches;  // L^-1 s, L^T lambda
    };
    std::vector<Columns> columns;
    int numColumns = 0;  // of the last solve
    MatrixXd thermal;
};

}  // namespace RigidHIPlugin

#endif
