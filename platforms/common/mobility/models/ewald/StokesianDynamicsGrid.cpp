#include "mobility/models/ewald/StokesianDynamicsGrid.h"

#include <algorithm>
#include <cmath>

#include "linearalgebra/BlockIncompleteCholesky.h"
#include "linearalgebra/Gmres.h"
#include "mobility/InnerErrors.h"
#include "mobility/NearAndFar.h"
#include "mobility/models/periodic/PeriodicMobility.h"

using namespace std;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

/** The preconditioner takes these parts of own mobilities for M. */
const double ofMotion = 0.35, ofStresslets = 0.6;

/** The preconditioner includes pairs nearer than this, in mean radii. */
const double nearInPreconditioner = 2.5;

class StokesianDynamicsGridAt : public MobilityAt, public NearAndFar {
public:
    explicit StokesianDynamicsGridAt(const StokesianDynamicsGrid& model)
        : MobilityAt(model), model(model), lubrication(model.getPairs()),
          ownFriction(6 * M_PI * viscosity * model.getFarField().rootsOfOwn().cwiseAbs2()),
          rootsOfStresslets((ownFriction.tail(5 * particles.size()) / ofStresslets).cwiseSqrt()) {
        for (int i = 0; i < particles.size(); i++) blockOf.push_back(i);
    }
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        solve(accuracy.error, forces, MatrixXd(), velocities, farForces);
    }
    void addStressletsOf(const DrivenFlow& flow, MatrixXd& slips) override;
    FlowSources sources(const MatrixXd& forces, const DrivenFlow* flow,
                        const Accuracy& accuracy) override;
    void addFlowAt(const FlowSources& sources, const vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        LatticeSum sumAtPoints(particles, overSurfaces(), true, true);
        sumAtPoints.setBox(here.box);
        sumAtPoints.addFlowAt(here.positions, sources, points, factor / (8 * M_PI * viscosity),
                              velocities);
    }
    double getSecondsOfGrid() const override { return inner ? inner->getSecondsOfGrid() : 0; }

    NearAndFar* parts() override { return this; }
    MobilityAt& far() override { return *inner; }
    void addNear(const MatrixXd& velocities, double factor, MatrixXd& forces) override;
    long long addNearNoise(const NoiseStream& noise, uint32_t purpose, MatrixXd& forces) override {
        findBlocks();
        return lubrication.addNoise(terms, noise, purpose, forces);
    }
    void solve(double tolerance, MatrixXd& velocities) override {
        MatrixXd slips = MatrixXd::Zero(ownFriction.size(), velocities.cols());
        slips.topRows(velocities.rows()) = velocities;
        solve(tolerance, MatrixXd::Zero(velocities.rows(), velocities.cols()), slips, velocities,
              farForces);
    }
    void solve(double tolerance, const MatrixXd& forces, const MatrixXd& slips,
               MatrixXd& velocities, MatrixXd& farForces) override {
        solve(true, tolerance, forces, slips, velocities, farForces);
    }
    bool slipsOfStrain(const DrivenFlow& flow, MatrixXd& forces, MatrixXd& slips) override;
    long long getNumProducts() const override { return numProducts; }
    long long getNumIterations() const override { return numIterations; }

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    void findBlocks();
    void makePreconditioner(bool lubricated);
    /** @param lubricated  whether spheres have lubrication; else Delta is 0 */
    void solve(bool lubricated, double tolerance, const MatrixXd& forces, const MatrixXd& slips,
               MatrixXd& velocities, MatrixXd& farForces);
    /** Whether lubrication acts on the strain of this flow, as in SpheresAt. */
    bool strainsPairs(const DrivenFlow& flow) const {
        return model.hasLubrication() && flow.hasGradient() && flow.waveVelocity == 0;
    }
    /**
     * Add the forces and stresslets of the lubrication of pairs, from velocities and from strain
     * rates of surfaces.
     */
    void addPairs(const VectorXd& twists, const VectorXd& strains, VectorXd& forces,
                  VectorXd& stresslets);
    /**
     * The velocities of force-free spheres relative to a flow, and M^-1 of these velocities: forces
     * and stresslets of the far field.
     */
    void relativeVelocities(const DrivenFlow& flow, double tolerance, MatrixXd& velocities,
                            MatrixXd& farForces);

    const StokesianDynamicsGrid& model;
    const Lubrication& lubrication;
    const VectorXd ownFriction;        // of all rows
    const VectorXd rootsOfStresslets;  // roots of the preconditioner's friction, for rows of
                                       // stresslets
    unique_ptr<MobilityAt> inner;
    Placement here;
    Lubrication::Terms terms;
    bool blocksAreKnown = false, preconditionerIsKnown = false, preconditionerHasPairs = false;
    vector<int> blockOf;
    BlockIncompleteCholesky nearFactor;
    Gmres gmres;
    MatrixXd rightSide, solution, product, farForces, unscaled;
    VectorXd rates;
    long long numProducts = 0, numIterations = 0;
};

void StokesianDynamicsGridAt::moveTo(const Placement& placement, bool nearby) {
    if (nearby)
        model.getFarField().placeNear(inner, placement);
    else
        model.getFarField().place(inner, placement);
    here = placement;
    blocksAreKnown = preconditionerIsKnown = false;
}

void StokesianDynamicsGridAt::findBlocks() {
    if (blocksAreKnown) return;
    lubrication.findTerms(here, terms);
    blocksAreKnown = true;
}

void StokesianDynamicsGridAt::addNear(const MatrixXd& velocities, double factor, MatrixXd& forces) {
    findBlocks();
    unscaled = factor * velocities;
    lubrication.addProduct(terms, unscaled, forces);
}

void StokesianDynamicsGridAt::makePreconditioner(bool lubricated) {
    if (preconditionerIsKnown && preconditionerHasPairs == lubricated) return;
    findBlocks();
    nearFactor.setZero(particles.size());
    for (int i = 0; i < particles.size(); i++)
        nearFactor.add(i, i,
                       (ownFriction.segment<6>(6 * i) / ofMotion).asDiagonal().toDenseMatrix());
    if (lubricated) lubrication.addNearer(nearInPreconditioner, terms, blockOf, {}, nearFactor);
    nearFactor.factorise();
    preconditionerIsKnown = true;
    preconditionerHasPairs = lubricated;
}

/**
 * Let D be the inverse of the preconditioner's M, and L L^T an approximation of D + Delta in the
 * rows of U. The iteration solves for y = (L^T U, D^1/2 S). Its equations are L^-1 D (U + M_FF
 * Delta U - M_FS S) = L^-1 D (M_FF F + s_U), and D^-1/2 (M_SS S - M_SF Delta U) = -D^-1/2 (M_SF F +
 * s_E). The 2-norm of y approximates the friction norm of U and S.
 */
void StokesianDynamicsGridAt::solve(bool lubricated, double tolerance, const MatrixXd& forces,
                                    const MatrixXd& slips, MatrixXd& velocities, MatrixXd& ofFar) {
    makePreconditioner(lubricated);
    tolerance = InnerErrors::ofIteration(tolerance);
    const int n = particles.numRows, m = ownFriction.size() - n;
    const Accuracy accuracy{InnerErrors::ofProductsForStresslets * tolerance};
    const auto toScaled = [&](MatrixXd& x) {
        x.topRows(n) = (ownFriction.head(n) / ofMotion).asDiagonal() * x.topRows(n);
        nearFactor.solveL(x.topRows(n));
        x.bottomRows(m) = rootsOfStresslets.asDiagonal() * x.bottomRows(m);
    };
    const auto fromScaled = [&](const MatrixXd& y, MatrixXd& x) {
        x = y;
        nearFactor.solveLTransposed(x.topRows(n));
        x.bottomRows(m) = rootsOfStresslets.asDiagonal() * x.bottomRows(m);
    };
    MatrixXd x, applied = MatrixXd::Zero(n + m, forces.cols());
    applied.topRows(n) = forces;
    if (forces.isZero(0)) {
        rightSide = applied;
    } else {
        inner->multiply(applied, rightSide, accuracy);
        numProducts += forces.cols();
    }
    if (slips.size() > 0) rightSide += slips;
    rightSide.bottomRows(m) *= -1;
    toScaled(rightSide);
    // Where L is poor, the 2-norm of y can be much larger than the friction norm of U and S.
    const Gmres::ErrorBound errorBound = {
        InnerErrors::boundBySingularValues * tolerance, [&](const MatrixXd& y) {
            fromScaled(y, x);
            MatrixXd friction = (ownFriction.head(n) / ofMotion).asDiagonal() * x.topRows(n);
            if (lubricated) addNear(x.topRows(n), 1, friction);
            return sqrt(x.topRows(n).cwiseProduct(friction).sum() + y.bottomRows(m).squaredNorm());
        }};
    gmres.solve(
        [&](const MatrixXd& y, MatrixXd& result) {
            fromScaled(y, x);
            applied.resize(n + m, x.cols());
            MatrixXd near = MatrixXd::Zero(n, x.cols());
            if (lubricated) addNear(x.topRows(n), -1, near);
            applied.topRows(n) = near;
            applied.bottomRows(m) = x.bottomRows(m);
            inner->multiply(applied, product, accuracy);
            numProducts += x.cols();
            result.resize(n + m, x.cols());
            result.topRows(n) = x.topRows(n) - product.topRows(n);
            result.bottomRows(m) = product.bottomRows(m);
            toScaled(result);
        },
        rightSide, InnerErrors::residualsOfStresslets * tolerance, solution, &errorBound);
    numIterations += gmres.getNumIterations();
    fromScaled(solution, x);
    MatrixXd rest = forces;
    if (lubricated) addNear(x.topRows(n), -1, rest);
    ofFar.resize(n + m, x.cols());
    ofFar.topRows(n) = rest;
    ofFar.bottomRows(m) = x.bottomRows(m);
    velocities = x.topRows(n);
}

void StokesianDynamicsGridAt::addPairs(const VectorXd& twists, const VectorXd& strains,
                                       VectorXd& forces, VectorXd& stresslets) {
    if (!model.hasLubrication()) return;
    findBlocks();
    for (const Lubrication::NearPair& pair : terms.pairs) {
        const double mean = 0.5 * (particles.radii[pair.i] + particles.radii[pair.j]);
        model.addLubricationForces(pair.distance * pair.axis, pair.i, pair.j,
                                   model.getReach().weight(pair.distance / mean), twists, strains,
                                   forces, stresslets);
    }
}

bool StokesianDynamicsGridAt::slipsOfStrain(const DrivenFlow& flow, MatrixXd& forces,
                                            MatrixXd& slips) {
    model.strainRates(flow, here.positions, rates);
    slips.setZero(ownFriction.size(), 1);
    slips.bottomRows(rates.size()) = rates;
    VectorXd ofPairs = VectorXd::Zero(particles.numRows), stresslets = VectorXd::Zero(rates.size());
    if (strainsPairs(flow)) addPairs(VectorXd::Zero(particles.numRows), rates, ofPairs, stresslets);
    forces = ofPairs;
    // As in SpheresAt, lubrication does not act on the strain of a wave: Delta is 0 there.
    return !model.hasLubrication() || flow.waveVelocity == 0;
}

void StokesianDynamicsGridAt::relativeVelocities(const DrivenFlow& flow, double tolerance,
                                                 MatrixXd& velocities, MatrixXd& ofFar) {
    MatrixXd forces, slips;
    const bool lubricated = slipsOfStrain(flow, forces, slips);
    solve(lubricated, tolerance, forces, slips, velocities, ofFar);
}

void StokesianDynamicsGridAt::addStressletsOf(const DrivenFlow& flow, MatrixXd& slips) {
    MatrixXd velocities;
    const double tolerance = InnerErrors::ofAnswers * model.getFarField().getTolerance();
    relativeVelocities(flow, tolerance, velocities, farForces);
    slips.col(0) += velocities;
}

FlowSources StokesianDynamicsGridAt::sources(const MatrixXd& forces, const DrivenFlow* flow,
                                             const Accuracy& accuracy) {
    FlowSources result;
    result.forces = forces;
    MatrixXd velocities, ofFlow, ofForces, ofFar;
    solve(accuracy.error, forces.col(0), MatrixXd(), velocities, ofFar);
    result.stresslets = ofFar.bottomRows(5 * particles.size());
    VectorXd ofPairs = VectorXd::Zero(particles.numRows),
             strains = VectorXd::Zero(5 * particles.size());
    if (flow) {
        relativeVelocities(*flow, accuracy.error, ofFlow, ofFar);
        result.stresslets += ofFar.bottomRows(5 * particles.size());
        if (strainsPairs(*flow)) {
            velocities += ofFlow;
            strains = -rates;
        }
    }
    addPairs(velocities, strains, ofPairs, result.stresslets);
    return result;
}

MobilityTraits onGrid(MobilityTraits traits) {
    traits.isIsotropic = false;
    traits.isAnchored = true;
    traits.isMatrixFree = true;
    traits.hasProducts = true;
    traits.productsIterate = true;
    traits.isMadeFromFriction = true;
    traits.slipsOfParts = true;
    return traits;
}

LubricationScene sceneOf(bool lubrication, const LubricationReach& reach) {
    LubricationScene scene;
    scene.reach = lubrication ? reach : LubricationReach{0, 0};
    scene.numPeriods = 3;
    return scene;
}

}  // namespace

StokesianDynamicsGrid::StokesianDynamicsGrid(const HydrodynamicParticles& particles,
                                             double viscosity, bool lubrication, double tolerance,
                                             double spacing, const LubricationReach& reach,
                                             const shared_ptr<GridFluid>& fluid)
    : StokesianDynamics(particles, viscosity, lubrication, 0, true, onGrid(traitsOf(lubrication)),
                        reach),
      farField(getParticles(), viscosity, tolerance, spacing, fluid, {}, true),
      pairs(getParticles(), viscosity, sceneOf(lubrication, reach), name()) {}

string StokesianDynamicsGrid::objection(const Placement& placement) const {
    Lubrication::NearPair found;
    if (!pairs.findOverlap(placement, found)) return {};
    const bool isImage = found.image != array<int, 3>{0, 0, 0};
    return objectionToPair(found.i, found.j, found.distance,
                           found.i == found.j ? "the nearest image of "
                           : isImage          ? "an image of "
                                              : "");
}

unique_ptr<MobilityAt> StokesianDynamicsGrid::makePlace() const {
    return make_unique<StokesianDynamicsGridAt>(*this);
}

}  // namespace RigidHIPlugin
