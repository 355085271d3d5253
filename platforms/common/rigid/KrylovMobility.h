#ifndef RIGIDHI_KRYLOV_MOBILITY_H_
#define RIGIDHI_KRYLOV_MOBILITY_H_

#include <chrono>
#include <memory>

#include "linearalgebra/Lanczos.h"
#include "rigid/BodyMobility.h"
#include "rigid/CollectiveModes.h"
#include "rigid/ErrorBudget.h"
#include "rigid/LubricatedSolver.h"
#include "rigid/MultiblobSolver.h"

namespace RigidHIPlugin {

/**
 * The mobility without any matrix over all bodies, to the tolerance: products with the particles'
 * mobility, MultiblobSolver for multiblobs (LubricatedSolver beside spheres with lubrication), and
 * Lanczos for noise. Lanczos sees M scaled by the
 * particles' own mobilities (for multiblobs: by the bodies' own matrices), so that neither units
 * nor unequal radii matter.
 */
class KrylovMobility : public BodyMobility {
public:
    /**
     * @param tolerance  relative, as the user has set it; setErrors() may set a part of it for
     *     iterations
     */
    KrylovMobility(const CoupledBodies& bodies, double tolerance);
    Way getWay() const override { return Krylov; }
    void setPoses(const std::vector<Pose>& poses, bool nearby = false) override {
        here.setPoses(poses, nearby);
    }
    void setErrors(const ErrorBudget& errors) override;
    void endDifferences() override;
    std::string describeProducts(const ErrorBudget& errors, bool withRoots) override;
    bool productsIterate() const override {
        return getSlipSpace().areOfBodies() && !spheres && !lubricated;
    }
    bool solvesIterate() const override { return !spheres && !lubricated; }
    bool rootsIterate() const override { return true; }
    using BodyMobility::solve;
    void solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) override;
    void keepForces(int column) override;
    void solveFromKept(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) override;
    void getBlobForces(MatrixXd& lambda) override;
    void multiplyNearby(const std::vector<Pose>& poses, const MatrixXd& lambda,
                        MatrixXd& slips) override;
    void differenceNearby(const std::vector<Pose>& forward, const std::vector<Pose>& backward,
                          const MatrixXd& lambda, bool noiseIsFrozen, MatrixXd& slips) override;
    bool wrenchNoiseIsOfBodies() const override { return false; }
    void drawForPairs(const NoiseStream& noise, uint32_t purpose) override {
        noiseOfPairs = noise;
        purposeOfPairs = purpose;
        pairsAreCounted = false;
    }
    long long takeNumPairNumbers() override;
    void slipsOf(RandomField& field, MatrixXd& slips) override;
    void flowSlipsOfSolve(const DrivenFlow& flow, MatrixXd& slips) override;
    void thermalWrench(const MatrixXd& W, MatrixXd& wrench) override;
    void thermalSlip(const MatrixXd& W, MatrixXd& slips) override;
    void forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) override;
    void forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) override;
    const MatrixXd& mobility() override;
    const MatrixXd& friction() override { return here.friction(); }
    void multiply(const MatrixXd& wrenches, MatrixXd& twists,
                  const Accuracy& accuracy = Accuracy()) override {
        multiplyAt(here, wrenches, twists,
                   bodies.productsIterate() ? Accuracy{budget.ofIterations()} : accuracy);
    }

protected:
    const std::vector<Eigen::Matrix3d>& getTurns() const override { return here.getTurns(); }
    const std::vector<Pose>& getPoses() const override { return here.getPoses(); }
    BodiesAt& particlesHere() override { return here; }
    void forceFreeTwists(const DrivenFlow* flow, const MatrixXd& slips, MatrixXd& twists) override;
    void particleForces(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& forces) override;
    void beginSolving() override;
    void endSolving() override;

private:
    enum Function { SquareRoot, InverseSquareRoot, Inverse };
    class ScaledFunction;
    void setBudget(const ErrorBudget& newBudget);
    double errorInSolves();
    /**
     * The mobility that roots are built on. Where products iterate, this is the mobility without
     * lubrication.
     */
    MobilityAt& ofRoots();
    /** A solve of slips of parts. */
    void solveParts(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists);
    void addPairNoise(MatrixXd& wrench);
    /** Of which components a solve gives the mobility: those that are free, or all (as if). */
    enum Components { OfFree, OfAll };
    LubricatedSolver& lubricatedAt(const BodiesAt& at, Components components);
    LubricatedSolver& solveLubricated(BodiesAt& at, Components components, const MatrixXd& wrenches,
                                      const MatrixXd& slips, bool slipsAreOfFlow, double tolerance,
                                      MatrixXd& twists);
    void solveBesideHeld(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists);
    void forcesOfRelative(const LubricatedSolver& from, const MatrixXd& twists,
                          const MatrixXd& slips, MatrixXd& forces);
    void differenceLubricated(const std::vector<Pose>& forward, const std::vector<Pose>& backward,
                              const MatrixXd& wrench, MatrixXd& twists);
    void variationAt(const std::vector<Pose>& poses, const MatrixXd& forces, const MatrixXd& twists,
                     MatrixXd& ofFar, MatrixXd& ofNear);
    void iterate(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists,
                 bool fromGuess = false);
    void multiplyAt(BodiesAt& at, const MatrixXd& wrenches, MatrixXd& twists,
                    const Accuracy& accuracy);
    /**
     * @param course  the course of the root's iterations at the last poses that were not nearby
     *     ones. At nearby poses the iterations follow this course, so that differences are
     *     accurate. null: no differences are taken
     */
    void applyFunction(Function kind, const MatrixXd& W, MatrixXd& result,
                       Lanczos::Course* course = nullptr);
    void forcesFromScaled(const MatrixXd& x, MatrixXd& forces);
    void findCollectiveModes();
    MultiblobSolver& theSolver();
    MultiblobSolver& solverAt(const BodiesAt& at);

    const bool spheres;     // K = 1, with or without own tensors
    const bool lubricated;  // spheres with lubrication are beside other bodies, or held
    const double wantedTolerance;
    ErrorBudget budget;
    BodiesAt here, elsewhere;
    std::unique_ptr<MultiblobSolver> solver;  // made when first needed
    std::unique_ptr<LubricatedSolver> lubricatedSolver;
    // The same as if nothing were held.
    std::unique_ptr<RigidMotion> motionOfAll;
    std::unique_ptr<MultiblobSolver> solverOfAll;
    std::unique_ptr<LubricatedSolver> lubricatedOfAll;
    std::unique_ptr<Lanczos> lanczos;  // likewise; one for each tolerance
    CollectiveModes modes;             // likewise; those of the first root of a step
    bool modesAreKnown = false;
    NoiseStream noiseOfPairs;
    uint32_t purposeOfPairs = 0;
    long long numPairNumbers = 0;
    bool pairsAreCounted = true;
    Lanczos::Course courseOfWrench, courseOfSlip;  // of the thermal vectors, for one W each
    Eigen::VectorXd ownScale;  // of rows of spheres: about the root of a particle's own friction
                               // over 6 pi viscosity
    int solving = 0;           // depth of nested calls
    std::chrono::steady_clock::time_point beginOfSolving;
    double gridSecondsBefore = 0;
    MatrixXd scratch, scaled, inner, thermal, wrenchesOfSolve, twistsOfSolve, farForcesOfSolve, N,
        columns, twistsOfColumns;
};

}  // namespace RigidHIPlugin

#endif
