#include "rigid/MultiblobSolver.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include <cmath>
#include <sstream>

#include "linearalgebra/ToleranceText.h"
#include "rigid/NullTwists.h"
#include "rigid/RigidMotion.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Far more than a mobility matrix needs: its preconditioned condition number is tens. */
const int maxIterations = 1000;
/**
 * For the particles of one body: the mean square of a product with random forces is that of the
 * elements of M, and with M = L L^T the mean square of L^-T x for random x is a part of the trace
 * of M^-1. L^-1 magnifies errors of products as much again. Forces are scaled by the roots of
 * particles' own mobilities.
 */
double amplificationOf(const MatrixXd& M) {
    const VectorXd scale = M.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd scaled = scale.asDiagonal() * M * scale.asDiagonal();
    const int n = M.rows();
    return scaled.norm() / sqrt(n) * scaled.llt().solve(MatrixXd::Identity(n, n)).trace() / n;
}

/** An orthonormal basis of the columns of A, with as many columns: zeros if there are fewer. */
MatrixXd basisOf(const MatrixXd& A) {
    const ColPivHouseholderQR<MatrixXd> decomposition(A);
    MatrixXd basis =
        decomposition.householderQ() * MatrixXd::Identity(A.rows(), decomposition.rank());
    const int known = basis.cols();
    basis.conservativeResize(NoChange, A.cols());
    basis.rightCols(A.cols() - known).setZero();
    return basis;
}

/**
 * The smallest Ritz value of the preconditioned matrix, from the steps of conjugate gradients and
 * the ratios of their gradients (Golub, Van Loan, Matrix Computations, section 11.3).
 */
double smallestRitzValue(const vector<double>& steps, const vector<double>& ratios) {
    const int k = steps.size();
    VectorXd diagonal(k), beside(max(0, k - 1));
    for (int i = 0; i < k; i++) {
        diagonal[i] = 1 / steps[i] + (i > 0 ? ratios[i] / steps[i - 1] : 0);
        if (i > 0) beside[i - 1] = sqrt(ratios[i]) / steps[i - 1];
    }
    SelfAdjointEigenSolver<MatrixXd> solver;
    solver.computeFromTridiagonal(diagonal, beside, EigenvaluesOnly);
    return solver.info() == Success ? solver.eigenvalues()[0] : 0;
}

/** The limit with rough products. After it the solve is tried with exact ones. */
const int maxRoughIterations = 100;

}  // namespace

MultiblobSolver::MultiblobSolver(const RigidMotion& motion, const NullTwists& nullTwists,
                                 const MobilityModel& model)
    : hasRoughProducts(model.getTraits().hasRoughProducts), numRows(motion.getNumRows()),
      numBlobRowsTotal(motion.getParticles().numRows),
      turns(motion.getElements().size(), Matrix3d::Identity()) {
    vector<shared_ptr<const Shape> > known;
    for (size_t e = 0; e < turns.size(); e++) {
        const FluidElement& element = motion.getElements()[e];
        rows.push_back(motion.firstRow(e));
        blobRow.push_back(motion.firstParticleRow(e));
        numBlobRows.push_back(element.numParticleRows());
        shared_ptr<const Shape> found;
        for (const auto& shape : known)
            if (shape->isFree == element.isFree() && shape->isSphere == element.isSphere() &&
                shape->radii == element.radii && shape->sites == element.sites &&
                shape->spin == element.spin)
                found = shape;
        if (!found) {
            const shared_ptr<Shape> shape(new Shape());
            shape->sites = element.sites;
            shape->radii = element.radii;
            shape->spin = element.spin;
            shape->isFree = element.isFree();
            shape->isSphere = element.isSphere();
            MatrixXd M;
            model.ownMobility(particlesOf({element}), sitesOf(element), M);
            shape->M.compute(M);
            // Two blobs at one place leave a pivot of rounding, of either sign.
            const double smallestCondition = 1e-14;
            if (shape->M.info() != Success || !(shape->M.rcond() > smallestCondition))
                throw OpenMM::OpenMMException(
                    "MobilityForce: the mobility matrix of the " + to_string(element.sites.size()) +
                    " blobs of body " + to_string(element.body) +
                    " is not positive definite; look for blobs at the same place");
            // In the energy norm, errors of products grow by the root of the condition number.
            growth = max(growth, 1 / sqrt(shape->M.rcond()));
            amplification = max(amplification, amplificationOf(M));
            shape->K = motion.ofElement_body(e);
            shape->MinvK = shape->M.solve(shape->K);
            shape->translations = shape->M.matrixL().solve(shape->K.leftCols(3));
            shape->friction = shape->K.transpose() * shape->MinvK;
            shape->N = generalisedInverse(shape->friction, nullTwists.inBody(e));
            shape->rigid = basisOf(shape->M.matrixL().solve(shape->K));
            known.push_back(shape);
            families.push_back({shape, {}});
            found = shape;
        }
        shapes.push_back(found);
        for (Family& family : families)
            if (family.shape == found) family.elements.push_back(e);
    }
}

void MultiblobSolver::setTurns(const vector<Matrix3d>& ofBodies) {
    for (size_t e = 0; e < turns.size(); e++)
        if (!shapes[e]->isFree) turns[e] = ofBodies[e];
}

/** Turn vectors of blobs (or bodies) between the lab frame and the frames of their bodies. */
void MultiblobSolver::turn(Rows kind, bool toBody, const MatrixXd& from, MatrixXd& to) const {
    to.resize(from.rows(), from.cols());
    for (size_t e = 0; e < shapes.size(); e++) {
        const int first = kind == OfBlobs ? blobRow[e] : rows[e];
        const int count = kind == OfBlobs ? numBlobRows[e] : shapes[e]->isFree ? 3 : 6;
        for (int r = first; r < first + count; r += 3)
            if (toBody)
                to.middleRows<3>(r).noalias() = turns[e].transpose() * from.middleRows<3>(r);
            else
                to.middleRows<3>(r).noalias() = turns[e] * from.middleRows<3>(r);
    }
}

int MultiblobSolver::firstRow(Rows kind, int element) const {
    return kind == OfBlobs ? blobRow[element] : rows[element];
}

void MultiblobSolver::gather(Rows kind, const Family& family, const MatrixXd& from,
                             MatrixXd& to) const {
    const int columns = from.cols(), count = family.elements.size();
    const int own = kind == OfBlobs ? family.shape->K.rows() : family.shape->K.cols();
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
 * and u = N~ K^T M~^-1 residual. K u is moved from the residual to the twists. A residual that goes
 * to zero then keeps its digits (Gould et al., section 5).
 */
void MultiblobSolver::project() {
    preconditioned.resize(residual.rows(), residual.cols());
    ofBodies.resize(twists_body.rows(), twists_body.cols());
    for (const Family& family : families) {
        const Shape& shape = *family.shape;
        gather(OfBlobs, family, residual, gathered);
        gatheredTwists.noalias() = shape.N * (shape.MinvK.transpose() * gathered);
        gathered.noalias() -= shape.K * gatheredTwists;
        scatter(OfBlobs, family, gathered, residual);
        scatter(OfBodies, family, gatheredTwists, ofBodies);
        shape.M.solveInPlace(gathered);
        scatter(OfBlobs, family, gathered, preconditioned);
    }
    twists_body += ofBodies;
}

void MultiblobSolver::multiply(MobilityAt& blobs, double error, const MatrixXd& from,
                               MatrixXd& to) {
    turn(OfBlobs, false, from, lab);
    blobs.applyWithin(error, lab, labProduct);
    turn(OfBlobs, true, labProduct, to);
}

void MultiblobSolver::multiplyForSolve(MobilityAt& blobs, double error, const MatrixXd& from,
                                       MatrixXd& to) {
    multiply(blobs, error, from, to);
    numProducts += from.cols();
    if (error == 0) numExactProducts += from.cols();
}

int MultiblobSolver::apply(MobilityAt& blobs, const MatrixXd& wrenches, double tolerance,
                           MatrixXd& twists) {
    return solve(blobs, wrenches, MatrixXd(), tolerance, MobilityAt::roughError, twists);
}

int MultiblobSolver::solve(MobilityAt& blobs, const MatrixXd& wrenches, const MatrixXd& slips,
                           double tolerance, double error, MatrixXd& twists, bool fromGuess) {
    numProducts = numExactProducts = 0;
    turn(OfBodies, true, wrenches, wrenches_body);
    if (slips.size() > 0)
        turn(OfBlobs, true, slips, slips_body);
    else
        slips_body.resize(0, 0);
    // Rough products that reduce a residual by less than this are not worth the exact ones.
    const double leastReduction = 0.1;
    vector<double> errors;
    if (hasRoughProducts && error > 0) errors.push_back(error);
    if (hasRoughProducts && error > MobilityAt::roughError)
        errors.push_back(MobilityAt::roughError);
    int iterations = 0;
    bool done = false;
    for (double rough : errors) {
        if (done || growth * rough >= leastReduction) continue;
        const int made = iterate(blobs, tolerance, rough, fromGuess);
        iterations += made;
        done = made <= maxRoughIterations;
    }
    if (!done) iterations += iterate(blobs, tolerance, 0, fromGuess);
    turn(OfBodies, false, twists_body, twists);
    return iterations;
}

/** Begin at the forces of blobs for bodies that do not feel each other. */
void MultiblobSolver::begin(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& forces) {
    forces.resize(numBlobRowsTotal, wrenches.cols());
    for (const Family& family : families) {
        const Shape& shape = *family.shape;
        gather(OfBodies, family, wrenches, gatheredTwists);
        if (slips.size() > 0) {
            gather(OfBlobs, family, slips, gathered);
            gatheredTwists.noalias() += shape.MinvK.transpose() * gathered;
        }
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
 * Add to the kept forces the response to the change of wrenches and slips, as of bodies that do not
 * feel each other.
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

/** By how much products of this error can reduce a residual before it is computed anew. */
double MultiblobSolver::reductionOf(double error) const {
    return error * max(growth, MobilityAt::leastRoughTolerance / MobilityAt::roughError);
}

double MultiblobSolver::errorFor(double tolerance) const { return tolerance / reductionOf(1); }

/** Of each column, twists in the norm of the bodies' own friction, squared. */
void MultiblobSolver::findEnergyOfTwists(VectorXd& energy) {
    const int columns = twists_body.cols();
    energy.setZero(columns);
    for (const Family& family : families) {
        gather(OfBodies, family, twists_body, gatheredTwists);
        gatheredForces.noalias() = family.shape->friction * gatheredTwists;
        const int count = family.elements.size();
        for (int i = 0; i < count; i++)
            for (int c = 0; c < columns; c++)
                energy[c] +=
                    gatheredTwists.col(i * columns + c).dot(gatheredForces.col(i * columns + c));
    }
}

/** @return iterations; with rough products, more than their limit if they do not converge */
int MultiblobSolver::iterate(MobilityAt& blobs, double tolerance, double error, bool fromGuess) {
    const int columns = wrenches_body.cols();
    const bool withSlips = slips_body.size() > 0;
    VectorXd slipEnergy = VectorXd::Zero(columns);
    if (withSlips) {
        slipsToScaled(slips_body, scaled);
        slipEnergy = scaled.colwise().squaredNorm().transpose();
    }
    if (fromGuess)
        beginFromGuess(wrenches_body, slips_body);
    else
        begin(wrenches_body, slips_body, lambda);
    const auto findResidual = [&](double errorOfProduct) {
        multiplyForSolve(blobs, errorOfProduct, lambda, residual);
        if (withSlips) residual += slips_body;
        twists_body.setZero(numRows, columns);
        project();
    };
    // Rough products reduce the residual by these factors, one after the other, with an exact
    // residual after each.
    const double reduction = reductionOf(error);
    const int stages =
        error > 0 && tolerance < reduction ? ceil(log(tolerance) / log(reduction)) : 1;
    int stage = 1;
    findResidual(error);
    direction = -preconditioned;
    VectorXd gradient(columns), energy(columns), energyOfTwists;
    // Of conjugate gradients, for each column.
    vector<vector<double> > steps(columns), ratios(columns);
    const auto smallestEigenvalue = [&](int column) {
        return steps[column].empty() ? 1
                                     : min(1.0, smallestRitzValue(steps[column], ratios[column]));
    };
    // Random velocities may have five tolerances, of which three are for the solve. Of the energy
    // of random slips, bodies have as large a part as they have of the rows.
    const double ofRandom = 3;
    const double partOfBodies = ofRandom * ofRandom * numRows / numBlobRowsTotal;
    const auto lookAt = [&](double wanted, double& worst) {
        bool reached = true;
        worst = 0;
        if (withSlips) findEnergyOfTwists(energyOfTwists);
        for (int c = 0; c < columns; c++) {
            gradient[c] = residual.col(c).dot(preconditioned.col(c));
            energy[c] = lambda.col(c).dot(residual.col(c)) +
                        wrenches_body.col(c).dot(twists_body.col(c)) + slipEnergy[c];
            if (withSlips) {
                energy[c] -= lambda.col(c).dot(slips_body.col(c));
                energy[c] = min(energy[c], max(energyOfTwists[c], partOfBodies * slipEnergy[c]));
            }
            // The smallest eigenvalue makes a difference only when the rest is small enough.
            if (!(gradient[c] <= wanted * wanted * energy[c]) ||
                !(gradient[c] <= wanted * wanted * energy[c] * smallestEigenvalue(c)))
                reached = false;
            if (energy[c] > 0) worst = max(worst, sqrt(abs(gradient[c]) / energy[c]));
        }
        return reached;
    };
    VectorXd before(columns);
    int iteration = 0;
    while (true) {
        double worst;
        const auto target = [&] {
            return stage == stages ? tolerance : pow(tolerance, double(stage) / stages);
        };
        bool reached = lookAt(target(), worst);
        while (reached && stage < stages) {
            stage++;
            findResidual(0);
            reached = lookAt(target(), worst);
        }
        if (reached) break;
        if (error > 0 && (iteration == maxRoughIterations || !gradient.allFinite()))
            return maxRoughIterations + 1;
        if (iteration++ == maxIterations || !gradient.allFinite()) {
            ostringstream text;
            text << "MobilityForce: the solver of rigid multiblobs has a relative residual of "
                 << worst << " after " << iteration << " iterations, above "
                 << toleranceText(tolerance, wantedTolerance)
                 << "; raise setSolverTolerance(), use setSolver(Dense), or look for bodies that "
                    "overlap deeply";
            throw OpenMM::OpenMMException(text.str());
        }
        VectorXd ratio = VectorXd::Zero(columns);
        if (iteration > 1)
            for (int c = 0; c < columns; c++) {
                ratio[c] = before[c] > 0 ? gradient[c] / before[c] : 0;
                direction.col(c) = ratio[c] * direction.col(c) - preconditioned.col(c);
            }
        else
            direction = -preconditioned;
        multiplyForSolve(blobs, error, direction, product);
        for (int c = 0; c < columns; c++) {
            const double curvature = direction.col(c).dot(product.col(c));
            const double step = curvature > 0 ? gradient[c] / curvature : 0;
            if (step > 0) {
                steps[c].push_back(step);
                ratios[c].push_back(ratio[c]);
            }
            lambda.col(c) += step * direction.col(c);
            residual.col(c) += step * product.col(c);
        }
        before = gradient;
        project();
    }
    return iteration;
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

void MultiblobSolver::rigidParts(const MatrixXd& x, MatrixXd& parts) {
    parts.resize(numRows, x.cols());
    for (const Family& family : families) {
        gather(OfBlobs, family, x, gathered);
        gatheredTwists.noalias() = family.shape->rigid.transpose() * gathered;
        scatter(OfBodies, family, gatheredTwists, parts);
    }
}

void MultiblobSolver::wrenchesFromScaled(const MatrixXd& x, MatrixXd& wrenches_lab) {
    scaledToForces(x, scaled);
    ofBodies.resize(numRows, x.cols());
    for (const Family& family : families) {
        gather(OfBlobs, family, scaled, gathered);
        gatheredTwists.noalias() = family.shape->K.transpose() * gathered;
        scatter(OfBodies, family, gatheredTwists, ofBodies);
    }
    turn(OfBodies, false, ofBodies, wrenches_lab);
}

}  // namespace RigidHIPlugin
