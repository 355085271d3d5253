#include "rigid/KrylovMobility.h"

#include "linearalgebra/Symmetrise.h"
#include "rigid/RoughProducts.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

KrylovMobility::KrylovMobility(const CoupledBodies& bodies, double tolerance)
    : BodyMobility(bodies), spheres(bodies.getMotion().isIdentity()), wantedTolerance(tolerance),
      toleranceOfStep(tolerance), tolerance(tolerance), here(bodies, costs),
      elsewhere(bodies, costs) {
    if (!spheres) return;
    const HydrodynamicParticles& particles = bodies.getParticles();
    ownScale.resize(particles.numRows);
    for (int i = 0; i < particles.size(); i++) {
        const double a = particles.radii[i];
        ownScale.segment<3>(particles.firstRow[i]).setConstant(sqrt(a));
        if (particles.hasTorque[i])
            ownScale.segment<3>(particles.firstRow[i] + 3).setConstant(sqrt(4.0 / 3.0 * a * a * a));
    }
}

void KrylovMobility::setTolerance(double relative, const ForDifferences& needed) {
    toleranceOfStep = relative;
    courseOfWrench = courseOfSlip = Lanczos::Course();
    modesAreKnown = false;
    setTolerances(relative * needed.partOfTolerance, needed);
}

void KrylovMobility::endDifferences() {
    ForDifferences none;
    none.exactSolves = false;
    setTolerances(toleranceOfStep, none);
}

/** The relative error of differences of products, which make drifts. */
double KrylovMobility::errorOfDifferences() const {
    const double part = 0.1, most = 1e-4;
    return min(most, part * toleranceOfStep);
}

void KrylovMobility::setTolerances(double relative, const ForDifferences& needed) {
    // The tolerance is in the norm of the friction. In this norm errors of products were up to a
    // hundred times as large.
    const double part = 0.01;
    exactProducts = needed.exactProducts;
    shareOfRough = needed.shareOfRough;
    coarseProducts = needed.coarseProducts && !exactProducts;
    const bool fast = !needed.exactSolves && bodies.getModel().hasFastProducts(part * relative);
    errorOfSolves = fast ? part * relative : 0;
    differencedSolves = needed.differencedSolves;
    if (relative == tolerance) return;
    tolerance = relative;
    lanczos.reset();
}

void KrylovMobility::beginSolving() {
    if (!bodies.getModel().getTraits().isMatrixFree || solving++ > 0) return;
    beginOfSolving = chrono::steady_clock::now();
    gridSecondsBefore = here.getSecondsOfGrid() + elsewhere.getSecondsOfGrid();
}

void KrylovMobility::endSolving() {
    if (!bodies.getModel().getTraits().isMatrixFree || --solving > 0) return;
    costs.secondsOfSolver +=
        chrono::duration<double>(chrono::steady_clock::now() - beginOfSolving).count() -
        (here.getSecondsOfGrid() + elsewhere.getSecondsOfGrid() - gridSecondsBefore);
}

MultiblobSolver& KrylovMobility::theSolver() {
    if (!solver)
        solver.reset(
            new MultiblobSolver(bodies.getMotion(), bodies.getNullTwists(), bodies.getModel()));
    return *solver;
}

MultiblobSolver& KrylovMobility::solverAt(const BodiesAt& at) {
    theSolver().wantedTolerance = wantedTolerance;
    solver->setTurns(at.getTurns());
    return *solver;
}

/** The error of fast products in solves, if there are any; else 0. */
double KrylovMobility::coarseErrorInSolves(double toleranceOfSolves) {
    const double error = min(coarsestError, theSolver().errorFor(toleranceOfSolves));
    return error > MobilityAt::roughError && bodies.getModel().hasFastProducts(error) ? error : 0;
}

/** The error of products in solves; 0: none. */
double KrylovMobility::errorInSolves() {
    if (exactProducts) return 0;
    const double coarse = coarseProducts ? coarseErrorInSolves(tolerance) : 0;
    return max(coarse, MobilityAt::roughError);
}

string KrylovMobility::describeProducts(bool coarse) {
    const MobilityModel& model = bodies.getModel();
    const double amplification = spheres ? 1 : theSolver().getAmplification();
    vector<double> inRoots;
    if (coarse) inRoots = coarseErrors(model, toleranceOfStep, amplification);
    const double fine =
        toleranceOfStep >= MobilityAt::leastRoughTolerance ? MobilityAt::roughError : 0;
    inRoots.push_back(fine);
    const double inSolves = coarse && !spheres ? coarseErrorInSolves(toleranceOfStep) : 0;
    const string roots = model.describeFastProducts(inRoots[0]),
                 solves = model.describeFastProducts(max(inSolves, fine));
    if (spheres || roots == solves) return roots;
    const auto text = [](const string& way) { return way.empty() ? "over all pairs" : way; };
    return "of roots " + text(roots) + ", of solves " + text(solves);
}

void KrylovMobility::multiplyAt(BodiesAt& at, const MatrixXd& wrenches, MatrixXd& twists,
                                double errorOfProducts) {
    const Solving timed(*this);
    const OwnTensors& own = bodies.getOwnTensors();
    const MatrixXd* forces = &wrenches;
    if (own.any()) {
        scratch = wrenches;
        own.wrenchesForModel(at.getTurns(), scratch);
        forces = &scratch;
    }
    if (spheres) {
        at.particles().applyWithin(errorOfProducts, *forces, twists);
        costs.products += wrenches.cols();
    } else {
        const int iterations = solverAt(at).solve(at.particles(), *forces, MatrixXd(), tolerance,
                                                  errorInSolves(), twists);
        costs.iterations += iterations;
        costs.products += solver->getNumProducts();
    }
    own.twists(at.getTurns(), twists);
}

void KrylovMobility::iterate(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists,
                             bool fromGuess) {
    costs.iterations += solverAt(here).solve(here.particles(), wrenches, slips, tolerance,
                                             errorInSolves(), twists, fromGuess);
    costs.products += solver->getNumProducts();
}

void KrylovMobility::solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
    const Solving timed(*this);
    if (!getSlipSpace().isIdentity()) {
        iterate(wrenches, slips, twists);
        return;
    }
    if (differencedSolves && !bodies.getOwnTensors().any()) {
        here.particles().applyForDifference(errorOfDifferences(), wrenches, twists);
        costs.products += wrenches.cols();
    } else
        multiply(wrenches, twists, errorOfSolves);
    wrenchesOfSolve = wrenches;
    if (slips.size() > 0) twists += slips;
}

void KrylovMobility::keepForces(int column) {
    if (!getSlipSpace().isIdentity()) solver->keepGuess(column);
}

void KrylovMobility::solveFromKept(const MatrixXd& wrenches, const MatrixXd& slips,
                                   MatrixXd& twists) {
    const Solving timed(*this);
    if (getSlipSpace().isIdentity())
        solve(wrenches, slips, twists);
    else
        iterate(wrenches, slips, twists, true);
}

void KrylovMobility::forceFreeTwists(const DrivenFlow&, const MatrixXd& slips, MatrixXd& twists) {
    const Solving timed(*this);
    const MatrixXd noWrenches = MatrixXd::Zero(bodies.getNumRows(), slips.cols());
    iterate(noWrenches, slips, twists);
}

void KrylovMobility::getBlobForces(MatrixXd& lambda) {
    if (getSlipSpace().isIdentity())
        lambda = wrenchesOfSolve;
    else
        solver->getBlobForces(lambda);
}

void KrylovMobility::multiplyNearby(const vector<Pose>& poses, const MatrixXd& forces,
                                    MatrixXd& slips) {
    elsewhere.anchorTo(here);
    elsewhere.setPoses(poses, true);
    if (getSlipSpace().areOfBodies()) {
        multiplyAt(elsewhere, forces, slips, 0);
        return;
    }
    elsewhere.particles().applyForDifference(errorOfDifferences(), forces, slips);
    costs.products += forces.cols();
}

/**
 * The modes in which many bodies move together, at these poses. Roots keep them until the next step
 * begins, so that all roots of a step are one smooth function of the poses.
 */
void KrylovMobility::findCollectiveModes() {
    if (modesAreKnown) return;
    modesAreKnown = true;
    modes.clear();
    const auto& elements = bodies.getElements();
    const int count = CollectiveModes::numGroups(elements.size(), bodies.getParticles().size());
    if (count == 0) return;
    const Placement& placement = here.getPlacement();
    const RigidMotion& motion = bodies.getMotion();
    vector<CollectiveModes::Member> members(elements.size());
    for (size_t e = 0; e < elements.size(); e++) {
        CollectiveModes::Member& member = members[e];
        member.firstRow = motion.firstParticleRow(e);
        if (spheres)
            member.translations =
                Matrix3d::Identity() * (sqrt(6 * M_PI * bodies.getModel().getViscosity()) *
                                        ownScale[motion.firstParticleRow(e)]);
        else
            member.translations = solverAt(here).scaledTranslations(e);
        member.centre.setZero();
        const int numSites = elements[e].sites.size();
        for (int i = 0; i < numSites; i++)
            member.centre += toEigen(placement.positions[motion.firstParticle(e) + i]) / numSites;
    }
    modes.compute(bodies.getModel(), members, count);
}

/**
 * result = f(S) W for a matrix that stands for M, S of MultiblobSolver, or ownScale M ownScale for
 * spheres. Roots are those of B S'^(1/2) or B^-T S'^(-1/2) with S = B S' B^T (CollectiveModes).
 */
void KrylovMobility::applyFunction(Function kind, const MatrixXd& W, MatrixXd& result,
                                   Lanczos::Course* course) {
    const Solving timed(*this);
    if (!lanczos)
        lanczos.reset(new Lanczos(tolerance, Lanczos::defaultIterations, wantedTolerance));
    findCollectiveModes();
    const SpectralFunction f = kind == SquareRoot          ? SpectralFunction::squareRoot()
                               : kind == InverseSquareRoot ? SpectralFunction::inverseSquareRoot()
                                                           : SpectralFunction::inverse();
    const vector<SpectralFunction> functions(W.cols(), f);
    MobilityAt& blobs = here.particles();
    MultiblobSolver* scaledSolver = spheres ? nullptr : &solverAt(here);
    const auto product = [&](double error) {
        return [&, error](const MatrixXd& x, MatrixXd& y) {
            const MatrixXd* from = &x;
            if (modes.any()) {
                inner = x;
                modes.solveTransposed(inner);
                from = &inner;
            }
            if (scaledSolver) {
                scaledSolver->multiplyScaled(blobs, error, *from, y);
            } else {
                scaled = ownScale.asDiagonal() * *from;
                blobs.applyWithin(error, scaled, y);
                y = ownScale.asDiagonal() * y;
            }
            modes.solve(y);
        };
    };
    // Errors of products of single precision are those of S, and not relative to the norm of S'.
    // Terms of a sum have independent errors, which are relative to products with any vector
    // without a preferred direction.
    const double termsOfSums = 3;
    const double ofModes = modes.any() ? termsOfSums * MobilityAt::roughError : 0;
    vector<Lanczos::Rough> rough;
    if (!exactProducts)
        rough =
            roughProducts(bodies.getModel(), tolerance, coarseProducts,
                          scaledSolver ? scaledSolver->getAmplification() : 1, ofModes, product);
    else if (shareOfRough > 0 && bodies.getModel().getTraits().hasRoughProducts)
        rough.push_back({product(MobilityAt::roughError), MobilityAt::roughError, ofModes, false,
                         shareOfRough});
    const bool follows =
        course && here.isNearby() && static_cast<int>(course->products.size()) == W.cols();
    const auto outer = [&](MatrixXd& x) {
        if (kind == SquareRoot)
            modes.multiply(x);
        else
            modes.solveTransposed(x);
    };
    // What moves bodies is to be right relative to itself: of many blobs it is a small part. Slips
    // move them by K^T M^-1 s.
    const auto rigid = [&](MatrixXd& x) {
        modes.solveTransposed(x);
        scaledSolver->rigidParts(x, inner);
        x.swap(inner);
    };
    vector<Lanczos::Outer> outers;
    if (modes.any()) outers.push_back({outer, false});
    if (scaledSolver && kind != Inverse) outers.push_back({rigid, kind == SquareRoot});
    lanczos->setOuter(outers);
    MatrixXd transformed;
    if (kind == Inverse && modes.any()) {
        transformed = W;
        modes.solve(transformed);
    }
    lanczos->apply(product(0), transformed.size() > 0 ? transformed : W, functions, result,
                   Lanczos::OwnNorm, rough, follows ? course : nullptr);
    outer(result);
    if (course && !follows) *course = lanczos->getCourse();
    costs.products += lanczos->getNumProducts();
    costs.iterations += lanczos->getNumIterations();
}

void KrylovMobility::thermalWrench(const MatrixXd& W, MatrixXd& wrench) {
    costs.roots++;
    applyFunction(InverseSquareRoot, W, scratch, &courseOfWrench);
    if (spheres)
        wrench = ownScale.asDiagonal() * scratch;
    else
        solverAt(here).wrenchesFromScaled(scratch, wrench);
    // N = B N_model B^T, so that a wrench on the bodies is B^-T times a wrench in the model.
    bodies.getOwnTensors().wrenchesFromModel(here.getTurns(), wrench);
}

void KrylovMobility::thermalSlip(const MatrixXd& W, MatrixXd& slips) {
    if (getSlipSpace().areOfBodies()) {
        thermalWrench(W, thermal);
        solve(thermal, slips);
        return;
    }
    costs.roots++;
    applyFunction(SquareRoot, W, scratch, &courseOfSlip);
    if (spheres)
        slips = ownScale.cwiseInverse().asDiagonal() * scratch;
    else
        solverAt(here).slipsFromScaled(scratch, slips);
}

void KrylovMobility::forcesOfThermalSlip(const MatrixXd& W, MatrixXd& forces) {
    if (getSlipSpace().areOfBodies()) {
        thermalWrench(W, forces);
        return;
    }
    costs.roots++;
    applyFunction(InverseSquareRoot, W, scratch);
    forcesFromScaled(scratch, forces);
}

void KrylovMobility::forcesFromScaled(const MatrixXd& x, MatrixXd& forces) {
    if (spheres)
        forces = ownScale.asDiagonal() * x;
    else
        solverAt(here).forcesFromScaled(x, forces);
}

void KrylovMobility::forcesOfSlips(const MatrixXd& slips, MatrixXd& forces) {
    MatrixXd scaledSlips;
    if (spheres)
        scaledSlips = ownScale.asDiagonal() * slips;
    else
        solverAt(here).scaledFromSlips(slips, scaledSlips);
    applyFunction(Inverse, scaledSlips, scratch);
    forcesFromScaled(scratch, forces);
}

void KrylovMobility::particleForces(const MatrixXd& wrenches, const MatrixXd& slips,
                                    MatrixXd& forces) {
    const Solving timed(*this);
    MatrixXd twists;
    iterate(wrenches, slips, twists);
    solverAt(here).getBlobForces(forces);
}

const MatrixXd& KrylovMobility::mobility() {
    if (!bodies.isWorthIterations()) return here.mobility();
    // So many columns share what products compute for each pair. More columns only need more
    // memory.
    const int batch = 24;
    const int numRows = bodies.getNumRows();
    N.resize(numRows, numRows);
    for (int first = 0; first < numRows; first += batch) {
        const int count = min(batch, numRows - first);
        columns.setZero(numRows, count);
        columns.middleRows(first, count).setIdentity();
        multiply(columns, twistsOfColumns);
        N.middleCols(first, count) = twistsOfColumns;
    }
    symmetrise(N);
    return N;
}

}  // namespace RigidHIPlugin
