#include "rigid/KrylovMobility.h"

#include "linearalgebra/Symmetrise.h"
#include "mobility/InnerErrors.h"
#include "mobility/NearAndFar.h"
#include "rigid/FrictionFactor.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

KrylovMobility::KrylovMobility(const CoupledBodies& bodies, double tolerance)
    : BodyMobility(bodies),
      spheres(bodies.getMotion().isIdentity() && !bodies.getFreeMotion().any()),
      lubricated(bodies.productsIterate() && !spheres), wantedTolerance(tolerance),
      budget(ErrorBudget::beforeSteps(tolerance)), here(bodies, costs), elsewhere(bodies, costs) {
    if (spheres) ownScale = rootsOfOwnFriction(bodies.getParticles(), getSlipSpace().areOfParts());
}

void KrylovMobility::setErrors(const ErrorBudget& errors) {
    courseOfWrench = courseOfSlip = Lanczos::Course();
    modesAreKnown = false;
    setBudget(errors);
}

void KrylovMobility::endDifferences() { setBudget(budget.afterDifferences()); }

void KrylovMobility::setBudget(const ErrorBudget& newBudget) {
    if (newBudget.ofIterations() != budget.ofIterations()) lanczos.reset();
    budget = newBudget;
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
        solver = make_unique<MultiblobSolver>(bodies.getMotion(), bodies.getNullTwists(),
                                              bodies.getModel());
    return *solver;
}

MultiblobSolver& KrylovMobility::solverAt(const BodiesAt& at) {
    theSolver().wantedTolerance = wantedTolerance;
    solver->setPoses(at.getPoses(), at.getTurns());
    return *solver;
}

/** The error of products in solves; 0: exact ones. */
double KrylovMobility::errorInSolves() {
    return budget.inSolves(bodies.getModel(), theSolver().errorFor(budget.ofIterations()));
}

string KrylovMobility::describeProducts(const ErrorBudget& errors, bool withRoots) {
    const MobilityModel& model = bodies.getModel();
    if (spheres) return model.describeFastProducts(errors.firstInRoots(model, 1));
    const string solves = model.describeFastProducts(
        lubricated ? 0 : errors.firstInSolves(model, theSolver().errorFor(errors.ofIterations())));
    if (!withRoots) return solves;
    const string roots =
        model.describeFastProducts(errors.firstInRoots(model, theSolver().getAmplification()));
    if (roots == solves) return roots;
    const auto text = [](const string& way) { return way.empty() ? "over all pairs" : way; };
    return "of roots " + text(roots) + ", of solves " + text(solves);
}

void KrylovMobility::multiplyAt(BodiesAt& at, const MatrixXd& wrenches, MatrixXd& twists,
                                const Accuracy& accuracy) {
    const Solving timed(*this);
    const OwnTensors& own = bodies.getOwnTensors();
    const MatrixXd* forces = &wrenches;
    if (own.any()) {
        scratch = wrenches;
        own.wrenchesForModel(at.getTurns(), scratch);
        forces = &scratch;
    }
    if (lubricated) {
        solveLubricated(at, OfFree, *forces, MatrixXd(), false,
                        InnerErrors::ofIteration(accuracy.error), twists);
    } else if (bodies.productsIterate()) {
        NearAndFar& parts = *at.particles().parts();
        const long long products = parts.getNumProducts(), iterations = parts.getNumIterations();
        at.particles().multiply(*forces, twists, accuracy);
        costs.products += parts.getNumProducts() - products;
        costs.iterations += parts.getNumIterations() - iterations;
    } else if (spheres) {
        at.particles().multiply(*forces, twists, accuracy);
        costs.products += wrenches.cols();
    } else {
        const int iterations = solverAt(at).solve(at.particles(), *forces, MatrixXd(),
                                                  budget.ofIterations(), errorInSolves(), twists);
        costs.iterations += iterations;
        costs.products += solver->getNumProducts();
    }
    own.twists(at.getTurns(), twists);
}

LubricatedSolver& KrylovMobility::lubricatedAt(const BodiesAt& at, Components components) {
    if (components == OfFree || !bodies.getFreeMotion().any()) {
        MultiblobSolver& multiblobs = solverAt(at);
        if (!lubricatedSolver)
            lubricatedSolver = make_unique<LubricatedSolver>(bodies.getMotion(), multiblobs);
        return *lubricatedSolver;
    }
    if (!lubricatedOfAll) {
        vector<FluidElement> elements = bodies.getElements();
        for (FluidElement& element : elements) {
            element.isHeld = false;
            element.fixed = 0;
        }
        motionOfAll = make_unique<RigidMotion>(elements);
        solverOfAll =
            make_unique<MultiblobSolver>(*motionOfAll, bodies.getNullTwists(), bodies.getModel());
        lubricatedOfAll = make_unique<LubricatedSolver>(*motionOfAll, *solverOfAll);
    }
    solverOfAll->setPoses(at.getPoses(), at.getTurns());
    return *lubricatedOfAll;
}

/**
 * @param slips           of particles; empty: none
 * @param slipsAreOfFlow  whether Delta acts on velocities relative to the slips, as for slips of a
 *     flow; if not, twists = N (F + K^T M^-1 s)
 * @return the solver, which has the forces
 */
LubricatedSolver& KrylovMobility::solveLubricated(BodiesAt& at, Components components,
                                                  const MatrixXd& wrenches, const MatrixXd& slips,
                                                  bool slipsAreOfFlow, double tolerance,
                                                  MatrixXd& twists) {
    const Solving timed(*this);
    LubricatedSolver& by = lubricatedAt(at, components);
    NearAndFar& parts = *at.particles().parts();
    const MatrixXd* total = &wrenches;
    MatrixXd near, withNear;
    if (slips.size() > 0 && slipsAreOfFlow) {
        near.setZero(slips.rows(), slips.cols());
        parts.addNear(slips, 1, near);
        bodies.getMotion().wrenches(at.getTurns(), near, withNear);
        withNear += wrenches;
        total = &withNear;
    }
    by.solve(parts, at.getTurns(), *total, slips, tolerance, twists);
    costs.products += by.getNumProducts();
    costs.iterations += by.getNumIterations();
    return by;
}

/** forces = lambda + Delta (K U - s) after a solve with slips of a flow, or without slips. */
void KrylovMobility::forcesOfRelative(const LubricatedSolver& from, const MatrixXd& twists,
                                      const MatrixXd& slips, MatrixXd& forces) {
    MatrixXd relative;
    bodies.getMotion().slips(here.getTurns(), twists, relative);
    if (slips.size() > 0) relative -= slips;
    forces = from.getFarForces();
    here.particles().parts()->addNear(relative, 1, forces);
}

/**
 * Slips of bodies are those of a flow in which the particles of each body move with it: U = N_c (F
 * + xi s), where xi is the friction of all bodies.
 */
void KrylovMobility::solveBesideHeld(const MatrixXd& wrenches, const MatrixXd& slips,
                                     MatrixXd& twists) {
    MatrixXd ofParticles, forces;
    if (slips.size() > 0) bodies.getMotion().slips(here.getTurns(), slips, ofParticles);
    const double error = budget.solvesAreDifferenced() ? 0 : budget.ofIterations();
    const LubricatedSolver& by = solveLubricated(here, OfFree, wrenches, ofParticles, true,
                                                 InnerErrors::ofIteration(error), twists);
    forcesOfRelative(by, twists, ofParticles, forces);
    bodies.getMotion().wrenches(here.getTurns(), forces, wrenchesOfSolve);
    farForcesOfSolve = by.getFarForces();
    twistsOfSolve = twists;
    if (slips.size() > 0) twistsOfSolve -= slips;
}

void KrylovMobility::iterate(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists,
                             bool fromGuess) {
    costs.iterations +=
        solverAt(here).solve(here.particles(), wrenches, slips, budget.ofIterations(),
                             errorInSolves(), twists, fromGuess);
    costs.products += solver->getNumProducts();
}

void KrylovMobility::solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
    const Solving timed(*this);
    if (!getSlipSpace().slipsAreTwists()) {
        if (lubricated)
            solveBesideHeld(wrenches, slips, twists);
        else
            iterate(wrenches, slips, twists);
        return;
    }
    if (getSlipSpace().areOfParts()) {
        solveParts(wrenches, slips, twists);
        return;
    }
    if (bodies.productsIterate()) {
        multiplyAt(here, wrenches, twists,
                   Accuracy{budget.solvesAreDifferenced() ? 0 : budget.ofIterations()});
    } else if (budget.solvesAreDifferenced() && !bodies.getOwnTensors().any()) {
        here.particles().multiply(wrenches, twists, budget.ofDifferences());
        costs.products += wrenches.cols();
    } else
        multiply(wrenches, twists, budget.ofProductsAsSolves(bodies.getModel()));
    wrenchesOfSolve = wrenches;
    twistsOfSolve = twists;
    if (lubricated) farForcesOfSolve = lubricatedSolver->getFarForces();
    if (slips.size() > 0) twists += slips;
}

void KrylovMobility::solveParts(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
    NearAndFar& parts = *here.particles().parts();
    const int rows = bodies.getNumRows();
    MatrixXd forces = wrenches, ofFar;
    if (slips.rows() > rows) {
        forces += slips.middleRows(rows, rows);
        ofFar = slips.bottomRows(getSlipSpace().getNumFarRows());
    }
    const long long products = parts.getNumProducts(), iterations = parts.getNumIterations();
    parts.solve(budget.solvesAreDifferenced() ? 0 : budget.ofIterations(), forces, ofFar, twists,
                farForcesOfSolve);
    costs.products += parts.getNumProducts() - products;
    costs.iterations += parts.getNumIterations() - iterations;
    wrenchesOfSolve = wrenches;
    twistsOfSolve = twists;
    if (slips.size() > 0) twists += slips.topRows(rows);
}

void KrylovMobility::keepForces(int column) {
    if (!getSlipSpace().slipsAreTwists() && !lubricated) solver->keepGuess(column);
}

void KrylovMobility::solveFromKept(const MatrixXd& wrenches, const MatrixXd& slips,
                                   MatrixXd& twists) {
    const Solving timed(*this);
    if (getSlipSpace().slipsAreTwists() || lubricated)
        solve(wrenches, slips, twists);
    else
        iterate(wrenches, slips, twists, true);
}

void KrylovMobility::forceFreeTwists(const DrivenFlow*, const MatrixXd& slips, MatrixXd& twists) {
    const Solving timed(*this);
    const MatrixXd noWrenches = MatrixXd::Zero(bodies.getNumRows(), slips.cols());
    if (lubricated)
        solveLubricated(here, OfAll, noWrenches, slips, true, budget.ofIterations(), twists);
    else
        iterate(noWrenches, slips, twists);
}

void KrylovMobility::getBlobForces(MatrixXd& lambda) {
    if (getSlipSpace().slipsAreTwists() || lubricated)
        lambda = wrenchesOfSolve;
    else
        solver->getBlobForces(lambda);
}

void KrylovMobility::multiplyNearby(const vector<Pose>& poses, const MatrixXd& forces,
                                    MatrixXd& slips) {
    elsewhere.anchorTo(here);
    elsewhere.setPoses(poses, true);
    if (lubricated && bodies.getFreeMotion().any()) {
        solveLubricated(elsewhere, OfAll, forces, MatrixXd(), false, InnerErrors::least, slips);
        return;
    }
    if (getSlipSpace().areOfBodies()) {
        multiplyAt(elsewhere, forces, slips, Accuracy());
        return;
    }
    elsewhere.particles().multiply(forces, slips, budget.ofDifferences());
    costs.products += forces.cols();
}

MobilityAt& KrylovMobility::ofRoots() {
    NearAndFar* const parts = here.particles().parts();
    return parts ? parts->far() : here.particles();
}

/** Compute M f and Delta U at nearby poses. */
void KrylovMobility::variationAt(const vector<Pose>& poses, const MatrixXd& forces,
                                 const MatrixXd& twists, MatrixXd& ofFar, MatrixXd& ofNear) {
    elsewhere.anchorTo(here);
    elsewhere.setPoses(poses, true);
    NearAndFar& parts = *elsewhere.particles().parts();
    parts.far().multiply(forces, ofFar, budget.ofDifferences());
    costs.products += forces.cols();
    ofNear.setZero(twists.rows(), twists.cols());
    parts.addNear(twists, 1, ofNear);
}

/**
 * As differenceNearby(), beside multiblobs and held bodies. N^-1 = K^T (M^-1 + Delta) K, so that
 * with U = N F and M lambda = K U the difference of N F is N times wrenches and slips: dN F = N
 * (-dK^T (lambda + Delta K U) - K^T dDelta K U - K^T Delta dK U + K^T M^-1 (dM lambda - dK U)).
 */
void KrylovMobility::differenceLubricated(const vector<Pose>& forward, const vector<Pose>& backward,
                                          const MatrixXd& wrench, MatrixXd& result) {
    const Solving timed(*this);
    const RigidMotion& motion = bodies.getMotion();
    NearAndFar& parts = *here.particles().parts();
    MatrixXd twists, ofFar;
    if (wrenchesOfSolve.rows() == wrench.rows() && wrenchesOfSolve.col(0) == wrench.col(0)) {
        twists = twistsOfSolve.col(0);
        ofFar = farForcesOfSolve.col(0);
    } else {
        ofFar =
            solveLubricated(here, OfAll, wrench, MatrixXd(), false, budget.ofIterations(), twists)
                .getFarForces();
    }
    MatrixXd velocities, slips, slipsBack, near, nearBack, moved, movedBack, wrenches, wrenchesBack;
    motion.slips(here.getTurns(), twists, velocities);
    MatrixXd total = ofFar;
    parts.addNear(velocities, 1, total);
    variationAt(forward, ofFar, velocities, slips, near);
    motion.slips(elsewhere.getTurns(), twists, moved);
    motion.wrenches(elsewhere.getTurns(), total, wrenches);
    variationAt(backward, ofFar, velocities, slipsBack, nearBack);
    motion.slips(elsewhere.getTurns(), twists, movedBack);
    motion.wrenches(elsewhere.getTurns(), total, wrenchesBack);
    moved -= movedBack;
    slips -= slipsBack + moved;
    near -= nearBack;
    parts.addNear(moved, 1, near);
    wrenches -= wrenchesBack;
    motion.wrenches(here.getTurns(), near, wrenchesBack);
    wrenches = -wrenches - wrenchesBack;
    solveLubricated(here, OfAll, wrenches, slips, false, budget.ofIterations(), result);
}

/**
 * With lubrication, differences of N follow from differences of M and of Delta (NearAndFar), by one
 * solve. No results of iterations are differenced.
 */
void KrylovMobility::differenceNearby(const vector<Pose>& forward, const vector<Pose>& backward,
                                      const MatrixXd& lambda, bool noiseIsFrozen, MatrixXd& slips) {
    if (!bodies.productsIterate() || bodies.getOwnTensors().any()) {
        BodyMobility::differenceNearby(forward, backward, lambda, noiseIsFrozen, slips);
        return;
    }
    if (lubricated) {
        differenceLubricated(forward, backward, lambda, slips);
        return;
    }
    const Solving timed(*this);
    NearAndFar& parts = *here.particles().parts();
    MatrixXd twists, forces = lambda, farBack, near, nearBack;
    if (getSlipSpace().areOfParts()) {
        const int rows = bodies.getNumRows();
        MatrixXd ofFar;
        twists = twistsOfSolve.col(0);
        forces = farForcesOfSolve.col(0);
        variationAt(forward, forces, twists, ofFar, near);
        variationAt(backward, forces, twists, farBack, nearBack);
        slips.setZero(getSlipSpace().getNumRows(), 1);
        if (!noiseIsFrozen) slips.middleRows(rows, rows) = nearBack - near;
        slips.bottomRows(ofFar.rows()) = ofFar - farBack;
        return;
    }
    if (wrenchesOfSolve.rows() == lambda.rows() && wrenchesOfSolve.col(0) == lambda.col(0))
        twists = twistsOfSolve.col(0);
    else
        multiplyAt(here, lambda, twists, Accuracy{budget.ofIterations()});
    parts.addNear(twists, -1, forces);
    variationAt(forward, forces, twists, slips, near);
    variationAt(backward, forces, twists, farBack, nearBack);
    slips -= farBack;
    near -= nearBack;
    parts.far().multiply(near, farBack);
    slips -= farBack;
    const long long products = parts.getNumProducts(), iterations = parts.getNumIterations();
    parts.solve(budget.ofIterations(), slips);
    costs.products += 1 + parts.getNumProducts() - products;
    costs.iterations += parts.getNumIterations() - iterations;
}

long long KrylovMobility::takeNumPairNumbers() {
    const long long count = numPairNumbers;
    numPairNumbers = 0;
    return count;
}

/**
 * Find the modes in which many bodies move together, at these poses. Roots keep these modes until
 * the next step begins, so that all roots of a step are one smooth function of the poses.
 */
void KrylovMobility::findCollectiveModes() {
    if (modesAreKnown) return;
    modesAreKnown = true;
    modes.clear();
    const auto& elements = bodies.getElements();
    // Held elements come first, and have no part in modes of motion.
    size_t firstMoving = 0;
    while (firstMoving < elements.size() && elements[firstMoving].isHeld) firstMoving++;
    const int count =
        CollectiveModes::numGroups(elements.size() - firstMoving, bodies.getParticles().size());
    if (count == 0) return;
    const Placement& placement = here.getPlacement();
    const RigidMotion& motion = bodies.getMotion();
    vector<CollectiveModes::Member> members(elements.size() - firstMoving);
    for (size_t e = firstMoving; e < elements.size(); e++) {
        CollectiveModes::Member& member = members[e - firstMoving];
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
 * A function of a matrix that stands for M: S of MultiblobSolver, or ownScale M ownScale for
 * spheres. Lanczos sees S' with S = B S' B^T (CollectiveModes). Roots are B S'^(1/2) or
 * B^-T S'^(-1/2), and the inverse is B^-T S'^-1 B^-1.
 */
class KrylovMobility::ScaledFunction {
public:
    ScaledFunction(KrylovMobility& mobility, Function kind)
        : mobility(mobility), kind(kind), modes(mobility.modes), blobs(mobility.ofRoots()),
          solver(mobility.spheres ? nullptr : &mobility.solverAt(mobility.here)) {}
    SpectralFunction ofEigenvalues() const;
    /** y = S' x; `error` as in Accuracy. */
    void multiply(double error, const MatrixXd& x, MatrixXd& y);
    vector<InexactProduct> inexactProducts();
    /** The vectors that an iteration for W begins with. */
    const MatrixXd& before(const MatrixXd& W);
    /** Turn results of the iteration into those of the function of S. */
    void after(MatrixXd& x) const;
    /** The parts of results of the iteration that move bodies. */
    void rigidParts(MatrixXd& x);
    /** The transforms of results that have to be right relative to their own norms. */
    vector<Lanczos::Outer> outers();

private:
    KrylovMobility& mobility;
    const Function kind;
    const CollectiveModes& modes;
    MobilityAt& blobs;
    MultiblobSolver* const solver;  // null for spheres
    MatrixXd transformed;
};

SpectralFunction KrylovMobility::ScaledFunction::ofEigenvalues() const {
    switch (kind) {
        case SquareRoot: return SpectralFunction::squareRoot();
        case InverseSquareRoot: return SpectralFunction::inverseSquareRoot();
        case Inverse: break;
    }
    return SpectralFunction::inverse();
}

void KrylovMobility::ScaledFunction::multiply(double error, const MatrixXd& x, MatrixXd& y) {
    const MatrixXd* from = &x;
    if (modes.any()) {
        mobility.inner = x;
        modes.solveTransposed(mobility.inner);
        from = &mobility.inner;
    }
    if (solver) {
        solver->multiplyScaled(blobs, error, *from, y);
    } else {
        const VectorXd& ownScale = mobility.ownScale;
        mobility.scaled = ownScale.asDiagonal() * *from;
        blobs.multiply(mobility.scaled, y, {error, Accuracy::Value});
        y = ownScale.asDiagonal() * y;
    }
    modes.solve(y);
}

vector<InexactProduct> KrylovMobility::ScaledFunction::inexactProducts() {
    return mobility.budget.inRoots(mobility.bodies.getModel(),
                                   solver ? solver->getAmplification() : 1, modes.any());
}

const MatrixXd& KrylovMobility::ScaledFunction::before(const MatrixXd& W) {
    if (kind != Inverse || !modes.any()) return W;
    transformed = W;
    modes.solve(transformed);
    return transformed;
}

void KrylovMobility::ScaledFunction::after(MatrixXd& x) const {
    if (kind == SquareRoot)
        modes.multiply(x);
    else
        modes.solveTransposed(x);
}

void KrylovMobility::ScaledFunction::rigidParts(MatrixXd& x) {
    modes.solveTransposed(x);
    solver->rigidParts(x, mobility.inner);
    x.swap(mobility.inner);
}

vector<Lanczos::Outer> KrylovMobility::ScaledFunction::outers() {
    vector<Lanczos::Outer> outers;
    if (modes.any()) outers.push_back({[this](MatrixXd& x) { after(x); }, false});
    // Only a small part of the vectors of many blobs moves their body. Slips move bodies by K^T
    // M^-1 s.
    if (solver && kind != Inverse)
        outers.push_back({[this](MatrixXd& x) { rigidParts(x); }, kind == SquareRoot});
    return outers;
}

void KrylovMobility::applyFunction(Function kind, const MatrixXd& W, MatrixXd& result,
                                   Lanczos::Course* course) {
    const Solving timed(*this);
    if (!lanczos)
        lanczos = make_unique<Lanczos>(budget.ofIterations(), Lanczos::defaultIterations,
                                       wantedTolerance);
    findCollectiveModes();
    ScaledFunction function(*this, kind);
    const vector<SpectralFunction> functions(W.cols(), function.ofEigenvalues());
    const bool follows =
        course && here.isNearby() && static_cast<int>(course->products.size()) == W.cols();
    const Lanczos::Product product = [&](double error, const MatrixXd& x, MatrixXd& y) {
        function.multiply(error, x, y);
    };
    lanczos->apply(product, function.before(W), functions, result, Lanczos::OwnNorm,
                   function.inexactProducts(), follows ? course : nullptr, function.outers());
    function.after(result);
    if (course && !follows) *course = lanczos->getCourse();
    costs.products += lanczos->getNumProducts();
    costs.iterations += lanczos->getNumIterations();
}

void KrylovMobility::thermalWrench(const MatrixXd& W, MatrixXd& wrench) {
    costs.roots++;
    applyFunction(InverseSquareRoot, W, scratch, &courseOfWrench);
    if (spheres)
        wrench = (ownScale.asDiagonal() * scratch).topRows(bodies.getNumParticleRows());
    else
        solverAt(here).wrenchesFromScaled(scratch, wrench);
    addPairNoise(wrench);
    // N = B N_model B^T, so that a wrench on the bodies is B^-T times a wrench in the model.
    bodies.getOwnTensors().wrenchesFromModel(here.getTurns(), wrench);
}

void KrylovMobility::addPairNoise(MatrixXd& wrench) {
    NearAndFar* const parts = here.particles().parts();
    if (!parts) return;
    long long numbers;
    if (lubricated) {
        MatrixXd ofParticles = MatrixXd::Zero(bodies.getNumParticleRows(), 1), ofBodies;
        numbers = parts->addNearNoise(noiseOfPairs, purposeOfPairs, ofParticles);
        bodies.getMotion().wrenches(here.getTurns(), ofParticles, ofBodies);
        wrench += ofBodies;
    } else {
        numbers = parts->addNearNoise(noiseOfPairs, purposeOfPairs, wrench);
    }
    if (!pairsAreCounted) numPairNumbers += numbers;
    pairsAreCounted = true;
}

void KrylovMobility::slipsOf(RandomField& field, MatrixXd& slips) {
    if (!getSlipSpace().areOfParts()) {
        BodyMobility::slipsOf(field, slips);
        return;
    }
    const int rows = bodies.getNumRows();
    MatrixXd ofField, wrench = MatrixXd::Zero(rows, 1);
    BodyMobility::slipsOf(field, ofField);
    addPairNoise(wrench);
    slips.setZero(getSlipSpace().getNumRows(), 1);
    slips.middleRows(rows, rows) = wrench;
    slips.bottomRows(ofField.rows()) = ofField;
}

void KrylovMobility::flowSlipsOfSolve(const DrivenFlow& flow, MatrixXd& slips) {
    MatrixXd forces, ofFar;
    if (!getSlipSpace().areOfParts() ||
        !here.particles().parts()->slipsOfStrain(flow, forces, ofFar)) {
        BodyMobility::flowSlipsOfSolve(flow, slips);
        return;
    }
    MatrixXd ofFlow;
    bodies.getModel().follow(flow, here.getPlacement(), ofFlow);
    slips.resize(getSlipSpace().getNumRows(), 1);
    slips << ofFlow, forces, ofFar;
}

void KrylovMobility::thermalSlip(const MatrixXd& W, MatrixXd& slips) {
    if (getSlipSpace().areOfBodies()) {
        thermalWrench(W, thermal);
        if (lubricated && bodies.getFreeMotion().any())
            solveLubricated(here, OfAll, thermal, MatrixXd(), false, budget.ofIterations(), slips);
        else
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
    if (NearAndFar* const parts = here.particles().parts()) parts->addNear(slips, 1, forces);
}

void KrylovMobility::particleForces(const MatrixXd& wrenches, const MatrixXd& slips,
                                    MatrixXd& forces) {
    const Solving timed(*this);
    MatrixXd twists;
    if (!lubricated) {
        iterate(wrenches, slips, twists);
        solverAt(here).getBlobForces(forces);
        return;
    }
    const LubricatedSolver& by =
        solveLubricated(here, OfAll, wrenches, slips, true, budget.ofIterations(), twists);
    forcesOfRelative(by, twists, slips, forces);
}

const MatrixXd& KrylovMobility::mobility() {
    if (!bodies.isWorthIterations()) {
        if (!bodies.getFreeMotion().any()) return here.mobility();
        MatrixXd ofAll = here.friction();
        FrictionFactor factor(bodies);
        if (!factor.compute(here.getTurns(), ofAll))
            refuseIndefiniteFriction(bodies.getElements().size());
        N.setIdentity(bodies.getNumRows(), bodies.getNumRows());
        factor.solve(here.getTurns(), N);
        symmetrise(N);
        return N;
    }
    // This many columns share the work of products for each pair. More columns only need more
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
