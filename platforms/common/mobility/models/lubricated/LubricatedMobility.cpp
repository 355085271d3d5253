#include "mobility/models/lubricated/LubricatedMobility.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "linearalgebra/BlockIncompleteCholesky.h"
#include "linearalgebra/CholeskyFactor.h"
#include "linearalgebra/Gmres.h"
#include "linearalgebra/SymmetricProduct.h"
#include "mobility/InnerErrors.h"
#include "mobility/NearAndFar.h"

using namespace std;
using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace RigidHIPlugin {

namespace {

/** The preconditioner includes pairs nearer than this, in mean radii. */
const double nearInPreconditioner = 2.5;

class LubricatedMobilityAt : public MobilityAt, public NearAndFar, public NearFactor {
public:
    LubricatedMobilityAt(const LubricatedMobility& model)
        : MobilityAt(model), model(model), lubrication(model.getLubrication()) {
        ownScale.resize(particles.numRows);
        for (int i = 0; i < particles.size(); i++)
            ownScale.segment(particles.firstRow[i], particles.hasTorque[i] ? 6 : 3)
                .setConstant(sqrt(6 * M_PI * viscosity * particles.radii[i]));
        for (int i = 0; i < particles.size(); i++)
            if (particles.hasTorque[i]) spheres.push_back(i);
        blockOf.assign(particles.size(), -1);
        for (size_t k = 0; k < spheres.size(); k++) blockOf[spheres[k]] = k;
    }
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override;
    void dense(MatrixXd& mobility) override;
    void friction(MatrixXd& friction) override;
    void addStressletsOf(const DrivenFlow& flow, MatrixXd& slips) override {
        inner->addStressletsOf(flow, slips);
    }
    FlowSources sources(const MatrixXd& forces, const DrivenFlow* flow,
                        const Accuracy& accuracy) override;
    void addFlowAt(const FlowSources& sources, const vector<OpenMM::Vec3>& points, double factor,
                   Velocities& velocities) override {
        inner->addFlowAt(sources, points, factor, velocities);
    }
    double getSecondsOfGrid() const override { return inner ? inner->getSecondsOfGrid() : 0; }
    NearAndFar* parts() override { return this; }

    MobilityAt& far() override { return *inner; }
    void addNear(const MatrixXd& velocities, double factor, MatrixXd& forces) override;
    long long addNearNoise(const NoiseStream& noise, uint32_t purpose, MatrixXd& forces) override;
    void solve(double tolerance, MatrixXd& velocities) override;
    void solve(double tolerance, const MatrixXd& forces, const MatrixXd& slips,
               MatrixXd& velocities, MatrixXd& farForces) override;
    NearFactor* factorOfFriction() override { return this; }
    void setFree(const vector<Projector>& free) override;
    void addOwn(const MatrixXd& velocities, MatrixXd& forces) override;
    void toScaled(const MatrixXd& velocities, MatrixXd& scaled) override;
    void fromScaled(const MatrixXd& scaled, MatrixXd& velocities) override;
    double energyOf(const MatrixXd& velocities) override;
    long long getNumProducts() const override { return numProducts; }
    long long getNumIterations() const override { return numIterations; }

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    void findBlocks();
    /** forces += the terms of Delta for spheres and walls, times velocities */
    void addWalls(const MatrixXd& velocities, MatrixXd& forces);
    void makePreconditioner();
    void gather(const MatrixXd& x, MatrixXd& blocks) const;
    void scatter(const MatrixXd& blocks, MatrixXd& x) const;

    const LubricatedMobility& model;
    const Lubrication& lubrication;
    unique_ptr<MobilityAt> inner;
    Placement here;
    Lubrication::Terms terms;                                // of pairs
    vector<Lubrication::Single> wallDeltas, wallRoots, own;  // of spheres
    bool blocksAreKnown = false, preconditionerIsKnown = false, mobilityIsKnown = false;
    vector<int> spheres, blockOf;
    Eigen::VectorXd ownScale;  // for rows of particles without torque: the root of their friction
    vector<Projector> freeMotions;  // NearFactor::setFree()
    BlockIncompleteCholesky nearFactor;
    Gmres gmres;
    CholeskyFactor factor;
    MatrixXd mobilityMatrix, scratch, rightSide, solution, blocks, ofSpheres, unscaled,
        forcesOfNear;
    long long numProducts = 0, numIterations = 0;
};

void LubricatedMobilityAt::moveTo(const Placement& placement, bool nearby) {
    if (nearby)
        model.getModel().placeNear(inner, placement);
    else
        model.getModel().place(inner, placement);
    here = placement;
    blocksAreKnown = preconditionerIsKnown = mobilityIsKnown = false;
}

void LubricatedMobilityAt::findBlocks() {
    if (blocksAreKnown) return;
    lubrication.findTerms(here, terms);
    wallDeltas.resize(spheres.size());
    wallRoots.resize(spheres.size());
    own.resize(spheres.size());
    for (size_t k = 0; k < spheres.size(); k++)
        lubrication.ofSphere(spheres[k], here.positions[spheres[k]][2], wallDeltas[k], wallRoots[k],
                             own[k]);
    blocksAreKnown = true;
}

void LubricatedMobilityAt::addNear(const MatrixXd& velocities, double factor, MatrixXd& forces) {
    findBlocks();
    unscaled = factor * velocities;
    lubrication.addProduct(terms, unscaled, forces);
    addWalls(unscaled, forces);
}

void LubricatedMobilityAt::addWalls(const MatrixXd& velocities, MatrixXd& forces) {
    if (!lubrication.getScene().hasWalls()) return;
    findBlocks();
    for (size_t k = 0; k < spheres.size(); k++) {
        const int rows[1] = {particles.firstRow[spheres[k]]};
        wallDeltas[k].addProduct(Vector3d::UnitZ(), rows, velocities, forces);
    }
}

long long LubricatedMobilityAt::addNearNoise(const NoiseStream& noise, uint32_t purpose,
                                             MatrixXd& forces) {
    findBlocks();
    long long count = lubrication.addNoise(terms, noise, purpose, forces);
    if (!lubrication.getScene().hasWalls()) return count;
    NoiseStream stream = noise;
    uint32_t index;
    MatrixXd numbers(6, 1), ofSphere(6, 1);
    const int only[1] = {0};
    for (size_t k = 0; k < spheres.size(); k++) {
        // A sphere and the wall use the random numbers of the pair of the sphere with itself.
        lubrication.keyOfPair({spheres[k], spheres[k], {0, 0, 0}, {}, 0}, stream.field, index);
        for (int b = 0; b < 3; b++)
            stream.pair(purpose, index, b, numbers(2 * b, 0), numbers(2 * b + 1, 0));
        ofSphere.setZero();
        wallRoots[k].addProduct(Vector3d::UnitZ(), only, numbers, ofSphere);
        forces.col(0).segment<6>(particles.firstRow[spheres[k]]) += ofSphere.col(0);
        count += 6;
    }
    return count;
}

// ---- Matrices

void LubricatedMobilityAt::friction(MatrixXd& friction) {
    findBlocks();
    inner->friction(friction);
    lubrication.addTo(terms, friction);
    if (!lubrication.getScene().hasWalls()) return;
    for (size_t k = 0; k < spheres.size(); k++) {
        const int rows[1] = {particles.firstRow[spheres[k]]};
        wallDeltas[k].addTo(Vector3d::UnitZ(), rows, friction);
    }
}

void LubricatedMobilityAt::dense(MatrixXd& mobility) {
    if (!mobilityIsKnown) {
        friction(scratch);
        if (!factor.compute(scratch)) refuseIndefiniteMobility(particles.size());
        scratch.setIdentity(particles.numRows, particles.numRows);
        factor.solveL(scratch);
        mobilityMatrix.setZero(particles.numRows, particles.numRows);
        addProductOfColumns(scratch, 1, mobilityMatrix);
        mirrorLower(mobilityMatrix);
        mobilityIsKnown = true;
    }
    mobility = mobilityMatrix;
}

// ---- Products

/**
 * Copy the rows of spheres, six each, from the rows of all particles; scatter() copies them back.
 */
void LubricatedMobilityAt::gather(const MatrixXd& x, MatrixXd& to) const {
    to.resize(6 * spheres.size(), x.cols());
    for (size_t k = 0; k < spheres.size(); k++)
        to.middleRows<6>(6 * k) = x.middleRows<6>(particles.firstRow[spheres[k]]);
}
void LubricatedMobilityAt::scatter(const MatrixXd& from, MatrixXd& x) const {
    for (size_t k = 0; k < spheres.size(); k++)
        x.middleRows<6>(particles.firstRow[spheres[k]]) = from.middleRows<6>(6 * k);
}

void LubricatedMobilityAt::makePreconditioner() {
    if (preconditionerIsKnown) return;
    findBlocks();
    const bool walls = lubrication.getScene().hasWalls();
    nearFactor.setZero(spheres.size());
    for (size_t k = 0; k < spheres.size(); k++) {
        Lubrication::Single block = own[k];
        if (walls) block += wallDeltas[k];
        Projector whole = block.whole(Vector3d::UnitZ());
        if (!freeMotions.empty()) {
            const Projector &free = freeMotions[k], fixed = Projector::Identity() - free;
            whole = (free * whole * free + fixed * own[k].whole(Vector3d::UnitZ()) * fixed).eval();
        }
        nearFactor.add(k, k, whole);
    }
    lubrication.addNearer(nearInPreconditioner, terms, blockOf, freeMotions, nearFactor);
    nearFactor.factorise();
    preconditionerIsKnown = true;
}

void LubricatedMobilityAt::setFree(const vector<Projector>& free) {
    if (free == freeMotions) return;
    freeMotions = free;
    preconditionerIsKnown = false;
}

void LubricatedMobilityAt::addOwn(const MatrixXd& velocities, MatrixXd& forces) {
    findBlocks();
    for (size_t k = 0; k < spheres.size(); k++) {
        const int rows[1] = {particles.firstRow[spheres[k]]};
        own[k].addProduct(Vector3d::UnitZ(), rows, velocities, forces);
    }
}

void LubricatedMobilityAt::toScaled(const MatrixXd& velocities, MatrixXd& scaled) {
    makePreconditioner();
    scaled = ownScale.asDiagonal() * velocities;
    ofSpheres.setZero(particles.numRows, velocities.cols());
    addOwn(velocities, ofSpheres);
    gather(ofSpheres, blocks);
    nearFactor.solveL(blocks);
    scatter(blocks, scaled);
}

void LubricatedMobilityAt::fromScaled(const MatrixXd& scaled, MatrixXd& velocities) {
    makePreconditioner();
    velocities = ownScale.cwiseInverse().asDiagonal() * scaled;
    gather(scaled, blocks);
    nearFactor.solveLTransposed(blocks);
    scatter(blocks, velocities);
}

double LubricatedMobilityAt::energyOf(const MatrixXd& velocities) {
    forcesOfNear.setZero(velocities.rows(), velocities.cols());
    addNear(velocities, 1, forcesOfNear);
    addOwn(velocities, forcesOfNear);
    for (int i = 0; i < particles.size(); i++)
        if (!particles.hasTorque[i]) {
            const int row = particles.firstRow[i];
            forcesOfNear.middleRows<3>(row) +=
                ownScale[row] * ownScale[row] * velocities.middleRows<3>(row);
        }
    return velocities.cwiseProduct(forcesOfNear).sum();
}

/**
 * The iteration solves L^-1 D (1 + M Delta) L^-T y = L^-1 D b for y = L^T U. The 2-norm of y
 * approximates the friction norm of U.
 */
void LubricatedMobilityAt::solve(double tolerance, MatrixXd& velocities) {
    setFree({});
    MatrixXd x, Mf;
    // Where L is poor, the 2-norm of y can be much larger than the friction norm of U.
    const Gmres::ErrorBound errorBound = {InnerErrors::boundBySingularValues * tolerance,
                                          [&](const MatrixXd& y) {
                                              fromScaled(y, x);
                                              return sqrt(energyOf(x));
                                          }};
    toScaled(velocities, rightSide);
    gmres.solve(
        [&](const MatrixXd& y, MatrixXd& result) {
            fromScaled(y, x);
            forcesOfNear.setZero(x.rows(), x.cols());
            addNear(x, 1, forcesOfNear);
            inner->multiply(forcesOfNear, Mf);
            numProducts += x.cols();
            x += Mf;
            toScaled(x, result);
        },
        rightSide, InnerErrors::residualsOfLubrication * tolerance, solution, &errorBound);
    numIterations += gmres.getNumIterations();
    fromScaled(solution, velocities);
}

void LubricatedMobilityAt::solve(double tolerance, const MatrixXd& forces, const MatrixXd& slips,
                                 MatrixXd& velocities, MatrixXd& farForces) {
    inner->multiply(forces, velocities);
    numProducts += forces.cols();
    if (slips.size() > 0) velocities += slips;
    solve(tolerance, velocities);
    farForces = forces;
    addNear(velocities, -1, farForces);
}

void LubricatedMobilityAt::multiply(const MatrixXd& forces, MatrixXd& velocities,
                                    const Accuracy& accuracy) {
    inner->multiply(forces, velocities);
    numProducts += forces.cols();
    solve(InnerErrors::ofIteration(accuracy.error), velocities);
}

/**
 * The lubrication forces of a pair of spheres cancel each other far away, so the forces on spheres
 * reach the fluid in full. The lubrication force between a sphere and a wall goes into the wall, so
 * it is no source of flow.
 */
FlowSources LubricatedMobilityAt::sources(const MatrixXd& forces, const DrivenFlow* flow,
                                          const Accuracy& accuracy) {
    if (!lubrication.getScene().hasWalls()) return inner->sources(forces, flow, accuracy);
    MatrixXd velocities, ofFar = forces;
    multiply(forces, velocities, accuracy);
    addWalls(-velocities, ofFar);
    return inner->sources(ofFar, flow, accuracy);
}

MobilityTraits withLubrication(MobilityTraits traits) {
    traits.mayObject = true;
    traits.holdsNearby = false;
    traits.isDivergenceFree = false;
    traits.isMadeFromFriction = true;
    traits.productsIterate = true;
    return traits;
}

}  // namespace

LubricatedMobility::LubricatedMobility(const HydrodynamicParticles& particles, double viscosity,
                                       const Spreading& spreading, const LubricationScene& scene,
                                       unique_ptr<MobilityModel> inner)
    : MobilityDecorator(particles, viscosity, withLubrication(inner->getTraits()), move(inner)),
      lubrication(getParticles(), viscosity, spreading, scene, name()) {}

string LubricatedMobility::objection(const Placement& placement) const {
    const string problem = getModel().objection(placement);
    return problem.empty() ? lubrication.objection(placement) : problem;
}

unique_ptr<MobilityAt> LubricatedMobility::makePlace() const {
    return make_unique<LubricatedMobilityAt>(*this);
}

}  // namespace RigidHIPlugin
