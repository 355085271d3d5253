#include "rigid/MultiblobSolver.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "linearalgebra/Decompositions.h"
#include "linearalgebra/ToleranceText.h"
#include "rigid/ErrorBudget.h"
#include "rigid/FreeMotion.h"
#include "rigid/NullTwists.h"
#include "rigid/RigidMotion.h"
#include "rigid/StoppingRule.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * Far more than a mobility matrix needs: with the preconditioner its condition number is some tens.
 */
const int maxIterations = 1000;
/**
 * MultiblobSolver::getAmplification() for the particles of one body. The mean square of a product
 * with random forces follows from the elements of M. With M = L L^T the mean square of L^-T x for
 * random x is the trace of M^-1 over the number of rows, and L^-1 magnifies errors of products as
 * much again. Forces are scaled by the roots of particles' own mobilities.
 */
double amplificationOf(const MatrixXd& M) {
    const VectorXd scale = M.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd scaled = scale.asDiagonal() * M * scale.asDiagonal();
    const int n = M.rows();
    const int largest = 500;
    if (n <= largest) return scaled.norm() / sqrt(n) * inverseOfPositive(scaled).trace() / n;
    // Estimate the trace by vectors of random signs, which a linear congruential generator gives.
    const int numProbes = 10;
    MatrixXd probes(n, numProbes);
    uint32_t number = 1;
    for (double& sign : probes.reshaped()) {
        number = 1664525 * number + 1013904223;
        sign = number >> 31 ? 1 : -1;
    }
    scaled.llt().matrixL().solveInPlace(probes);
    return scaled.norm() / sqrt(n) * probes.squaredNorm() / numProbes / n;
}

/** An orthonormal basis of the columns of A, filled up with zeros to the number of columns of A. */
MatrixXd basisOf(const MatrixXd& A) {
    const ColPivHouseholderQR<MatrixXd> decomposition(A);
    MatrixXd basis =
        decomposition.householderQ() * MatrixXd::Identity(A.rows(), decomposition.rank());
    const int known = basis.cols();
    basis.conservativeResize(NoChange, A.cols());
    basis.rightCols(A.cols() - known).setZero();
    return basis;
}

/** The limit with inexact products. Beyond it the solver tries more exact ones. */
const int maxInexactIterations = 100;

}  // namespace

MultiblobSolver::MultiblobSolver(const RigidMotion& motion, const NullTwists& nullTwists,
                                 const MobilityModel& model)
    : motion(motion), nullTwists(nullTwists), model(model),
      hasSinglePrecision(model.getTraits().hasSinglePrecision), numRows(motion.getNumRows()),
      numBlobRowsTotal(motion.getParticles().numRows) {
    const auto& elements = motion.getElements();
    int heldBlobs = 0;
    for (const FluidElement& element : elements)
        if (element.isHeld) heldBlobs += element.particles.size();
    if (heldBlobs > 0 && heldBlobs <= mostHeldBlobs)
        heldBlock = make_unique<HeldBlock>(motion, model);
    vector<shared_ptr<const Shape>> known;
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        for (int k = 0; k < element.numRows(); k++) numFreeRows += !element.isFixed(k);
        const bool isRestricted = !element.isWhollyFree() && !element.isWhollyFixed(),
                   isInBlock = element.isHeld && heldBlock;
        shared_ptr<const Shape> found;
        for (const auto& shape : known)
            if (!isRestricted && shape->isFree == element.isFree() &&
                shape->isSphere == element.isSphere() && shape->radii == element.radii &&
                shape->sites == element.sites && shape->spin == element.spin &&
                shape->fixed == element.fixed && shape->isInBlock == isInBlock)
                found = shape;
        if (!found) {
            MatrixXd M;
            model.ownMobility(particlesOf({element}), sitesOf(element), M);
            const auto shape =
                makeShape(element, M, motion.ofElement_body(e), nullTwists.inBody(e));
            shape->isInBlock = isInBlock;
            if (isRestricted)
                restricted.push_back({(int)e, shape});
            else
                known.push_back(shape);
            families.push_back({shape, {}});
            found = shape;
        }
        for (Family& family : families)
            if (family.shape == found) family.elements.push_back(e);
        shapes.push_back(found);
        turns.push_back(Matrix3d::Identity());
    }
}

/** @param element  the first one of those that have this shape */
shared_ptr<MultiblobSolver::Shape> MultiblobSolver::makeShape(const FluidElement& element,
                                                              const MatrixXd& M, const MatrixXd& K,
                                                              const VectorXd& nullTwist) {
    const auto shape = make_shared<Shape>();
    shape->sites = element.sites;
    shape->radii = element.radii;
    shape->spin = element.spin;
    shape->isFree = element.isFree();
    shape->isSphere = element.isSphere();
    shape->fixed = element.fixed;
    shape->isHeld = element.isWhollyFixed();
    shape->M.compute(M);
    // Two blobs at one place leave a pivot that is rounding, of either sign.
    const double smallestCondition = 1e-14;
    if (shape->M.info() != Success || !(shape->M.rcond() > smallestCondition))
        throw OpenMM::OpenMMException(
            "MobilityForce: the mobility matrix of the " + to_string(element.sites.size()) +
            " blobs of body " + to_string(element.body) +
            " is not positive definite; look for blobs at the same place");
    // In the energy norm, errors of products grow by the root of the condition number.
    growth = max(growth, 1 / sqrt(shape->M.rcond()));
    amplification = max(amplification, amplificationOf(M));
    shape->K = K;
    shape->numBlobRows = M.rows();
    shape->numBodyRows = K.cols();
    if (shape->isHeld) return shape;  // nothing moves it
    shape->MinvK = shape->M.solve(shape->K);
    shape->friction = shape->K.transpose() * shape->MinvK;
    shape->scaledK = shape->M.matrixL().solve(shape->K);
    shape->N = generalisedInverse(shape->friction, nullTwist);
    shape->rigid = basisOf(shape->scaledK);
    return shape;
}

/** Compute N of elements with some fixed components, in their frames. */
void MultiblobSolver::restrict(const vector<Matrix3d>& ofBodies) {
    for (const auto& [e, shape] : restricted) {
        const FreeMotion free({motion.getElements()[e]}, {0});
        const vector<Matrix3d> turn = {ofBodies[e]};
        const MatrixXd toLab =
            twoRotations(ofBodies[e]).topLeftCorner(free.getNumRows(), free.getNumRows());
        MatrixXd friction = toLab * shape->friction * toLab.transpose();
        free.order(turn, friction);
        const int count = free.getNumFree();
        MatrixXd N = MatrixXd::Zero(free.getNumRows(), free.getNumRows());
        N.topLeftCorner(count, count) = pseudoInverse(friction.topLeftCorner(count, count));
        free.fromOrdered(turn, N);
        N.transposeInPlace();
        free.fromOrdered(turn, N);
        shape->N = toLab.transpose() * N * toLab;
    }
}

void MultiblobSolver::setPoses(const vector<Pose>& poses, const vector<Matrix3d>& ofBodies) {
    // In the energy norm, errors of products grow by the root of the condition number.
    if (heldBlock && heldBlock->setPoses(poses, ofBodies))
        growth = max(growth, 1 / sqrt(heldBlock->getCondition()));
    restrict(ofBodies);
    for (size_t e = 0; e < shapes.size(); e++)
        if (!shapes[e]->isFree) turns[e] = ofBodies[e];
}

/** Turn vectors of blobs (or bodies) between the lab frame and the frames of their bodies. */
void MultiblobSolver::turn(Rows kind, bool toBody, const MatrixXd& from, MatrixXd& to) const {
    to.resize(from.rows(), from.cols());
    for (size_t e = 0; e < shapes.size(); e++) {
        const int first = firstRow(kind, e);
        const int count = kind == OfBlobs ? shapes[e]->numBlobRows : shapes[e]->numBodyRows;
        for (int r = first; r < first + count; r += 3)
            if (toBody)
                to.middleRows<3>(r).noalias() = turns[e].transpose() * from.middleRows<3>(r);
            else
                to.middleRows<3>(r).noalias() = turns[e] * from.middleRows<3>(r);
    }
}

int MultiblobSolver::firstRow(Rows kind, int element) const {
    return kind == OfBlobs ? motion.firstParticleRow(element) : motion.firstRow(element);
}

void MultiblobSolver::gather(Rows kind, const Family& family, const MatrixXd& from,
                             MatrixXd& to) const {
    const int columns = from.cols(), count = family.elements.size();
    const int own = kind == OfBlobs ? family.shape->numBlobRows : family.shape->numBodyRows;
    to.resize(own, count * columns);
    for (int i = 0; i < count; i++)
        to.middleCols(i * columns, columns) =
            from.middleRows(firstRow(kind, family.elements[i]), own);
}

void MultiblobSolver::scatter(Rows kind, const Family& family, const MatrixXd& from,
                              MatrixXd& to) const {
    const int columns = to.cols();
    for (size_t i = 0; i < family.elements.size(); i++)
        to.middleRows(firstRow(kind, family.elements[i]), from.rows()) =
            from.middleCols(i * columns, columns);
}

template <class Act>
void MultiblobSolver::actOnBlobs(const MatrixXd& from, MatrixXd& to, const Act& act) {
    to.resize(from.rows(), from.cols());
    for (const Family& family : families) {
        gather(OfBlobs, family, from, gathered);
        act(*family.shape, gathered);
        scatter(OfBlobs, family, gathered, to);
    }
}

/**
 * preconditioned = M~^-1 (residual - K u) with K^T preconditioned = 0, M~ the bodies' own matrices,
 * and u = N~ K^T M~^-1 residual. K u moves from the residual to the twists, so that the residual
 * keeps its digits as it goes to zero (Gould et al., section 5).
 */
void MultiblobSolver::project() {
    preconditioned.resize(residual.rows(), residual.cols());
    ofBodies.resize(twists_body.rows(), twists_body.cols());
    for (const Family& family : families) {
        const Shape& shape = *family.shape;
        gather(OfBlobs, family, residual, gathered);
        if (shape.isHeld) {
            gatheredTwists.setZero(shape.numBodyRows, gathered.cols());
        } else {
            gatheredTwists.noalias() = shape.N * (shape.MinvK.transpose() * gathered);
            gathered.noalias() -= shape.K * gatheredTwists;
            scatter(OfBlobs, family, gathered, residual);
        }
        scatter(OfBodies, family, gatheredTwists, ofBodies);
        if (shape.isInBlock) continue;
        shape.M.solveInPlace(gathered);
        scatter(OfBlobs, family, gathered, preconditioned);
    }
    if (heldBlock) heldBlock->apply(residual, preconditioned);
    twists_body += ofBodies;
}

void MultiblobSolver::multiply(MobilityAt& blobs, double error, const MatrixXd& from,
                               MatrixXd& to) {
    turn(OfBlobs, false, from, lab);
    blobs.multiply(lab, labProduct, {error, Accuracy::Value});
    turn(OfBlobs, true, labProduct, to);
}

int MultiblobSolver::apply(MobilityAt& blobs, const MatrixXd& wrenches, double tolerance,
                           MatrixXd& twists) {
    return solve(blobs, wrenches, MatrixXd(), tolerance, Accuracy::errorOfSinglePrecision, twists);
}

/** The iteration of one solve, with products of one error. */
class MultiblobSolver::Attempt {
public:
    Attempt(MultiblobSolver& solver, MobilityAt& blobs, double tolerance, double error)
        : solver(solver), blobs(blobs), tolerance(tolerance), error(error),
          wrenches(solver.wrenches_body), slips(solver.slips_body), lambda(solver.lambda),
          residual(solver.residual), preconditioned(solver.preconditioned),
          direction(solver.direction), product(solver.product), twists(solver.twists_body),
          columns(wrenches.cols()), withSlips(slips.size() > 0), gradient(columns), scale(columns),
          steps(columns) {
        const double reduction = ErrorBudget::reductionBy(error, solver.growth);
        if (error > 0 && tolerance < reduction) stages = ceil(log(tolerance) / log(reduction));
    }
    /** @return whether the tolerance is reached. With exact products run() reaches it or throws. */
    bool run(bool fromGuess) {
        begin(fromGuess);
        while (!reachesTolerance()) {
            if (isGivenUp()) return false;
            descend();
        }
        return true;
    }
    /** The number of iterations; one more than the limit if the attempt was given up. */
    int getNumIterations() const { return numIterations; }

private:
    void begin(bool fromGuess);
    bool reachesTolerance();
    bool isGivenUp();
    void descend();
    void multiply(double errorOfProduct, const MatrixXd& from, MatrixXd& to);
    void findResidual(double errorOfProduct);
    void measure();
    bool isWithin(double allowed) const;
    [[noreturn]] void refuse() const;

    MultiblobSolver& solver;
    MobilityAt& blobs;
    const double tolerance, error;
    // Members of the solver, which keeps their memory; in the frames of the bodies.
    const MatrixXd &wrenches, &slips;
    MatrixXd &lambda, &residual, &preconditioned, &direction, &product, &twists;
    const int columns;
    const bool withSlips;
    // Inexact products reduce the residual by the same factor in each stage. After each stage the
    // residual is computed exactly.
    int stage = 1, stages = 1;
    int numIterations = 0;
    // Of each column: the energies of the residual now and one iteration before, the scale of the
    // error, and the energies of slips, twists and rounding.
    VectorXd gradient, before, scale, slipEnergy, twistEnergy, rounding;
    vector<ConjugateSteps> steps;
};

void MultiblobSolver::Attempt::begin(bool fromGuess) {
    if (withSlips) solver.findEnergyOfSlips(slips, slipEnergy);
    if (fromGuess)
        solver.beginFromGuess(wrenches, slips);
    else
        solver.begin(wrenches, slips, lambda);
    solver.findRounding(wrenches, rounding);
    findResidual(error);
}

void MultiblobSolver::Attempt::multiply(double errorOfProduct, const MatrixXd& from, MatrixXd& to) {
    solver.multiply(blobs, errorOfProduct, from, to);
    solver.numProducts += columns;
    if (errorOfProduct == 0) solver.numExactProducts += columns;
}

void MultiblobSolver::Attempt::findResidual(double errorOfProduct) {
    multiply(errorOfProduct, lambda, residual);
    if (withSlips) residual += slips;
    twists.setZero(solver.numRows, columns);
    solver.project();
}

/** Compute the energies of the residual, and the scales of errors. */
void MultiblobSolver::Attempt::measure() {
    if (withSlips) solver.findEnergyOfTwists(twistEnergy);
    for (int c = 0; c < columns; c++) {
        gradient[c] = residual.col(c).dot(preconditioned.col(c));
        scale[c] = lambda.col(c).dot(residual.col(c)) + wrenches.col(c).dot(twists.col(c));
        if (!withSlips) {
            scale[c] = max(scale[c], rounding[c]);
            continue;
        }
        const double ofAll = scale[c] + slipEnergy[c] - lambda.col(c).dot(slips.col(c));
        scale[c] = scaleWithSlips(ofAll, twistEnergy[c], slipEnergy[c], solver.numFreeRows,
                                  solver.numBlobRowsTotal);
    }
}

bool MultiblobSolver::Attempt::isWithin(double allowed) const {
    for (int c = 0; c < columns; c++)
        if (!errorIsWithin(allowed, gradient[c], scale[c], steps[c])) return false;
    return true;
}

/** Go to the next stage, as often as the present one has reached its part of the tolerance. */
bool MultiblobSolver::Attempt::reachesTolerance() {
    measure();
    while (stage < stages && isWithin(pow(tolerance, double(stage) / stages))) {
        stage++;
        findResidual(0);
        measure();
    }
    return stage == stages && isWithin(tolerance);
}

/**
 * Whether inexact products get no further.
 *
 * @throws OpenMMException if exact products get no further
 */
bool MultiblobSolver::Attempt::isGivenUp() {
    const int limit = error > 0 ? maxInexactIterations : maxIterations;
    if (numIterations < limit && gradient.allFinite()) return false;
    if (error == 0) refuse();
    numIterations = limit + 1;
    return true;
}

void MultiblobSolver::Attempt::refuse() const {
    double worst = 0;
    for (int c = 0; c < columns; c++)
        if (scale[c] > 0) worst = max(worst, sqrt(abs(gradient[c]) / scale[c]));
    ostringstream text;
    text << "MobilityForce: the solver of rigid multiblobs has a relative residual of " << worst
         << " after " << numIterations + 1 << " iterations, above "
         << toleranceText(tolerance, solver.wantedTolerance)
         << "; raise setSolverTolerance(), use setSolver(Dense), or look for bodies that overlap "
            "deeply";
    throw OpenMM::OpenMMException(text.str());
}

/** One iteration of conjugate gradients. */
void MultiblobSolver::Attempt::descend() {
    VectorXd ratio = VectorXd::Zero(columns);
    if (numIterations == 0)
        direction = -preconditioned;
    else
        for (int c = 0; c < columns; c++) {
            ratio[c] = before[c] > 0 ? gradient[c] / before[c] : 0;
            direction.col(c) = ratio[c] * direction.col(c) - preconditioned.col(c);
        }
    multiply(error, direction, product);
    for (int c = 0; c < columns; c++) {
        const double curvature = direction.col(c).dot(product.col(c));
        const double length = curvature > 0 ? gradient[c] / curvature : 0;
        if (length > 0) steps[c].add(length, ratio[c]);
        lambda.col(c) += length * direction.col(c);
        residual.col(c) += length * product.col(c);
    }
    before = gradient;
    solver.project();
    numIterations++;
}

int MultiblobSolver::solve(MobilityAt& blobs, const MatrixXd& wrenches, const MatrixXd& slips,
                           double tolerance, double error, MatrixXd& twists, bool fromGuess) {
    numProducts = numExactProducts = 0;
    turn(OfBodies, true, wrenches, wrenches_body);
    if (slips.size() > 0)
        turn(OfBlobs, true, slips, slips_body);
    else
        slips_body.resize(0, 0);
    int iterations = 0;
    for (double ofProducts : ErrorBudget::attemptsOfSolve(error, growth, hasSinglePrecision)) {
        Attempt attempt(*this, blobs, tolerance, ofProducts);
        const bool done = attempt.run(fromGuess);
        iterations += attempt.getNumIterations();
        if (done) break;
    }
    turn(OfBodies, false, twists_body, twists);
    return iterations;
}

/** Begin at the blob forces of bodies that do not feel each other. */
void MultiblobSolver::begin(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& forces) {
    forces.resize(numBlobRowsTotal, wrenches.cols());
    if (heldBlock && slips.size() > 0) {
        heldBlock->apply(slips, forces);
        forces.topRows(heldBlock->getNumRows()) *= -1;
    } else if (heldBlock)
        forces.topRows(heldBlock->getNumRows()).setZero();
    for (const Family& family : families) {
        const Shape& shape = *family.shape;
        if (shape.isInBlock) continue;
        gather(OfBodies, family, wrenches, gatheredTwists);
        if (slips.size() > 0) {
            gather(OfBlobs, family, slips, gathered);
            if (!shape.isHeld) gatheredTwists.noalias() += shape.MinvK.transpose() * gathered;
        }
        if (shape.isHeld)
            gatheredForces.setZero(shape.numBlobRows, gatheredTwists.cols());
        else
            gatheredForces.noalias() = shape.MinvK * (shape.N * gatheredTwists);
        if (slips.size() > 0) {
            shape.M.solveInPlace(gathered);
            gatheredForces -= gathered;
        }
        scatter(OfBlobs, family, gatheredForces, forces);
    }
}

void MultiblobSolver::keepGuess(int column) {
    lambdaOfGuess = lambda.col(column);
    if (slips_body.size() > 0)
        slipsOfGuess = slips_body.col(column);
    else
        slipsOfGuess.setZero(lambda.rows(), 1);
    wrenchesOfGuess = wrenches_body.col(column);
}

/**
 * Add to the kept forces the response of bodies that do not feel each other to the change of
 * wrenches and slips.
 */
void MultiblobSolver::beginFromGuess(const MatrixXd& wrenches, const MatrixXd& slips) {
    product = wrenches - wrenchesOfGuess;
    if (slips.size() > 0)
        residual = slips - slipsOfGuess;
    else
        residual = -slipsOfGuess;
    begin(product, residual, lambda);
    lambda += lambdaOfGuess;
}

double MultiblobSolver::errorFor(double tolerance) const {
    return tolerance / ErrorBudget::reductionBy(1, growth);
}

/**
 * Where axes turn with the body, rounding turns a part of a wrench on fixed components into one on
 * free components. Compute the energy of this part, for each column.
 */
void MultiblobSolver::findRounding(const MatrixXd& wrenches, VectorXd& energy) {
    const double ofRotations = 1e-14;
    energy.setZero(wrenches.cols());
    for (const Family& family : families) {
        const Shape& shape = *family.shape;
        if (shape.isHeld || shape.fixed == 0) continue;
        gather(OfBodies, family, wrenches, gatheredTwists);
        // Nothing resists a rod's rotation about its line.
        const double least = 1e-9 * shape.friction.diagonal().maxCoeff();
        for (int row = 0; row < gatheredTwists.rows(); row++) {
            if (shape.friction(row, row) < least) continue;
            for (int c = 0; c < gatheredTwists.cols(); c++)
                energy[c % wrenches.cols()] +=
                    pow(ofRotations * gatheredTwists(row, c), 2) / shape.friction(row, row);
        }
    }
}

/** Of each column, slips in the norm of the preconditioner. */
void MultiblobSolver::findEnergyOfSlips(const MatrixXd& slips, VectorXd& energy) {
    slipsToScaled(slips, scaled);
    const int held = heldBlock ? heldBlock->getNumRows() : 0;
    energy = scaled.bottomRows(scaled.rows() - held).colwise().squaredNorm().transpose();
    if (!heldBlock) return;
    preconditioned.resize(slips.rows(), slips.cols());
    heldBlock->apply(slips, preconditioned);
    for (int c = 0; c < slips.cols(); c++)
        energy[c] += slips.col(c).head(held).dot(preconditioned.col(c).head(held));
}

/** Of each column, twists in the norm of the bodies' own friction, squared. */
void MultiblobSolver::findEnergyOfTwists(VectorXd& energy) {
    const int columns = twists_body.cols();
    energy.setZero(columns);
    for (const Family& family : families) {
        if (family.shape->isHeld) continue;
        gather(OfBodies, family, twists_body, gatheredTwists);
        gatheredForces.noalias() = family.shape->friction * gatheredTwists;
        const int count = family.elements.size();
        for (int i = 0; i < count; i++)
            for (int c = 0; c < columns; c++)
                energy[c] +=
                    gatheredTwists.col(i * columns + c).dot(gatheredForces.col(i * columns + c));
    }
}

void MultiblobSolver::getBlobForces(MatrixXd& lambda_lab) const {
    turn(OfBlobs, false, lambda, lambda_lab);
}

void MultiblobSolver::multiplyScaled(MobilityAt& blobs, double error, const MatrixXd& x,
                                     MatrixXd& y) {
    scaledToForces(x, scaled);
    multiply(blobs, error, scaled, y);
    slipsToScaled(y, y);
}

/** L^-T x, in the frames of the bodies. */
void MultiblobSolver::scaledToForces(const MatrixXd& x, MatrixXd& forces) {
    actOnBlobs(x, forces,
               [](const Shape& shape, MatrixXd& own) { shape.M.matrixU().solveInPlace(own); });
}

/** L^-1 slips, which are in the frames of the bodies. */
void MultiblobSolver::slipsToScaled(const MatrixXd& slips, MatrixXd& x) {
    actOnBlobs(slips, x,
               [](const Shape& shape, MatrixXd& own) { shape.M.matrixL().solveInPlace(own); });
}

void MultiblobSolver::slipsFromScaled(const MatrixXd& x, MatrixXd& slips_lab) {
    actOnBlobs(x, scaled, [this](const Shape& shape, MatrixXd& own) {
        gatheredForces.noalias() = shape.M.matrixL() * own;
        own.swap(gatheredForces);
    });
    turn(OfBlobs, false, scaled, slips_lab);
}

void MultiblobSolver::scaledFromSlips(const MatrixXd& slips_lab, MatrixXd& x) {
    turn(OfBlobs, true, slips_lab, x);
    slipsToScaled(x, x);
}

void MultiblobSolver::forcesFromScaled(const MatrixXd& x, MatrixXd& forces_lab) {
    scaledToForces(x, scaled);
    turn(OfBlobs, false, scaled, forces_lab);
}

template <class Act>
void MultiblobSolver::reduceToBodies(const MatrixXd& from, MatrixXd& to, bool alsoHeld,
                                     const Act& act) {
    to.resize(numRows, from.cols());
    for (const Family& family : families) {
        const Shape& shape = *family.shape;
        gather(OfBlobs, family, from, gathered);
        if (shape.isHeld && !alsoHeld)
            gatheredTwists.setZero(shape.numBodyRows, gathered.cols());
        else
            act(shape, gathered, gatheredTwists);
        scatter(OfBodies, family, gatheredTwists, to);
    }
}

void MultiblobSolver::rigidParts(const MatrixXd& x, MatrixXd& parts) {
    reduceToBodies(x, parts, false, [](const Shape& shape, const MatrixXd& own, MatrixXd& result) {
        result.noalias() = shape.rigid.transpose() * own;
    });
}

void MultiblobSolver::wrenchesFromScaled(const MatrixXd& x, MatrixXd& wrenches_lab) {
    scaledToForces(x, scaled);
    reduceToBodies(scaled, ofBodies, true,
                   [](const Shape& shape, const MatrixXd& own, MatrixXd& result) {
                       result.noalias() = shape.K.transpose() * own;
                   });
    turn(OfBodies, false, ofBodies, wrenches_lab);
}

void MultiblobSolver::ownTwists(const MatrixXd& x, MatrixXd& twists_lab) {
    reduceToBodies(x, ofBodies, false,
                   [](const Shape& shape, const MatrixXd& own, MatrixXd& result) {
                       result.noalias() = shape.N * (shape.scaledK.transpose() * own);
                   });
    turn(OfBodies, false, ofBodies, twists_lab);
}

void MultiblobSolver::ownRigid(const MatrixXd& x, MatrixXd& rigid) {
    actOnBlobs(x, rigid, [this](const Shape& shape, MatrixXd& own) {
        if (shape.isHeld) {
            own.setZero();
            return;
        }
        gatheredTwists.noalias() = shape.N * (shape.scaledK.transpose() * own);
        own.noalias() = shape.scaledK * gatheredTwists;
    });
}

void MultiblobSolver::ownForces(const MatrixXd& wrenches_lab, MatrixXd& x) {
    turn(OfBodies, true, wrenches_lab, ofBodies);
    x.resize(numBlobRowsTotal, wrenches_lab.cols());
    for (const Family& family : families) {
        const Shape& shape = *family.shape;
        gather(OfBodies, family, ofBodies, gatheredTwists);
        if (shape.isHeld)
            gathered.setZero(shape.numBlobRows, gatheredTwists.cols());
        else
            gathered.noalias() = shape.scaledK * (shape.N * gatheredTwists);
        scatter(OfBlobs, family, gathered, x);
    }
}

}  // namespace RigidHIPlugin
