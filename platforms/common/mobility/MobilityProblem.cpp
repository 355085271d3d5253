#include "mobility/MobilityProblem.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Geometry>

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

MobilityProblem::MobilityProblem(BodyMobility& bodies, bool matrixFree, double tolerance)
    : bodies(bodies), matrixFree(matrixFree), tolerance(tolerance), toleranceOfProducts(tolerance),
      bodySlips(bodies.constant || bodies.hasOwnTensors || !bodies.model || bodies.model->isMadeFromFriction()),
      lanczos(new Lanczos(tolerance)) {
    const auto& elements = bodies.getElements();
    nearest_body.resize(elements.size());
    for (size_t e = 0; e < elements.size(); e++) {
        if (bodySlips || bodies.motion.isIdentity()) continue;
        const MatrixXd K = bodies.motion.ofElement_body(e);
        nearest_body[e] = generalisedInverse(K.transpose() * K, bodies.nullTwists.inBody(e)) * K.transpose();
    }
    if (bodies.motion.isIdentity()) {
        const HydrodynamicParticles& particles = getParticles();
        ownScale.resize(particles.numRows);
        for (int i = 0; i < particles.size(); i++) {
            const double a = particles.radii[i];
            ownScale.segment<3>(particles.firstRow[i]).setConstant(sqrt(a));
            if (particles.hasTorque[i])
                ownScale.segment<3>(particles.firstRow[i] + 3).setConstant(sqrt(4.0 / 3.0 * a * a * a));
        }
    }
    if (bodies.constant) {
        bodies.setPoses({Pose()});
        friction = bodies.friction();
        factoriseFriction();
    }
}

void MobilityProblem::setTolerance(double relative, bool exactProducts) {
    toleranceOfProducts = exactProducts ? 0 : relative;
    if (relative == tolerance) return;
    tolerance = relative;
    lanczos.reset(new Lanczos(tolerance, Lanczos::defaultIterations, bodies.wantedTolerance));
}

void MobilityProblem::setPoses(const vector<Pose>& poses, bool nearby) {
    bodies.setPoses(poses, nearby);
    if (!bodies.constant) isFactorised = false;
}

/** The friction of bodies, in the lower triangle of `friction`, lifted along null twists, as its Cholesky factor. */
void MobilityProblem::factoriseFriction() {
    bodies.nullTwists.lift(bodies.turns, friction);
    if (!xi.compute(friction)) refuseIndefiniteFriction(getElements().size());
    isFactorised = true;
}

void MobilityProblem::factorise() {
    if (isFactorised) return;
    if (bodySlips) {
        friction = bodies.friction();
        factoriseFriction();
        return;
    }
    bodies.numMatrices++;
    bodies.here->dense(mobility);
    if (!M.compute(mobility)) refuseIndefiniteMobility(getParticles().size());
    if (bodies.motion.isIdentity()) {
        isFactorised = true;
        return;
    }
    bodies.motion.fill(bodies.turns, LK);
    M.solveL(LK);
    friction.setZero(getNumRows(), getNumRows());
    friction.selfadjointView<Lower>().rankUpdate(LK.transpose());
    factoriseFriction();
}

void MobilityProblem::solve(const MatrixXd& wrenches, const MatrixXd& slips, MatrixXd& twists) {
    const bool withSlips = slips.size() > 0;
    if (bodies.constant) {
        twists.noalias() = bodies.mobility() * wrenches;
    } else if (matrixFree) {
        if (bodySlips || bodies.motion.isIdentity()) {
            bodies.applyMatrixFree(wrenches, tolerance, twists);
        } else {
            MultiblobSolver& solver = bodies.getMultiblobSolver();
            const int iterations = solver.solve(*bodies.here, wrenches, slips, tolerance, toleranceOfProducts, twists);
            bodies.numSolverIterations += iterations;
            bodies.numProducts += (iterations + 1) * wrenches.cols();
            return;
        }
    } else {
        factorise();
        if (bodySlips) {
            twists = wrenches;
            xi.solve(twists);
        } else if (bodies.motion.isIdentity()) {
            halfForces.noalias() = M.U() * wrenches;
            twists.noalias() = M.L() * halfForces;
        } else {
            twists = wrenches;
            if (withSlips) {
                halfSlips = slips;
                M.solveL(halfSlips);
                twists.noalias() += LK.transpose() * halfSlips;
            }
            bodies.nullTwists.removeTorques(bodies.turns, twists);
            xi.solve(twists);
            bodies.nullTwists.removeTurns(bodies.turns, twists);
            halfForces.noalias() = LK * twists;  // L^T lambda
            if (withSlips) halfForces -= halfSlips;
            return;
        }
    }
    lambda = wrenches;  // K = 1
    if (withSlips) twists += slips;
}

void MobilityProblem::getBlobForces(MatrixXd& result) {
    if (bodySlips || bodies.motion.isIdentity())
        result = lambda;
    else if (matrixFree)
        bodies.multiblobSolver->getBlobForces(result);
    else {
        result = halfForces;
        M.solveU(result);
    }
}

/** result = f(S) W for a matrix S that stands for M: that of MultiblobSolver, or ownScale M ownScale for K = 1. */
void MobilityProblem::applyRoot(const SpectralFunction& f, const MatrixXd& W, MatrixXd& result) {
    const vector<SpectralFunction> functions(W.cols(), f);
    MobilityAt& blobs = *bodies.here;
    MultiblobSolver* solver = bodies.motion.isIdentity() ? nullptr : &bodies.getMultiblobSolver();
    const auto product = [&](double productTolerance) {
        return [&, productTolerance](const MatrixXd& x, MatrixXd& y) {
            if (solver) {
                solver->multiplyScaled(blobs, productTolerance, x, y);
                return;
            }
            scaled = ownScale.asDiagonal() * x;
            blobs.applyFor(productTolerance, scaled, y);
            y = ownScale.asDiagonal() * y;
        };
    };
    lanczos->apply(product(0), W, functions, result, Lanczos::OwnNorm,
                   toleranceOfProducts > 0 ? Lanczos::Product(product(toleranceOfProducts)) : Lanczos::Product());
    bodies.numProducts += lanczos->getNumProducts();
    bodies.numSolverIterations += lanczos->getNumIterations();
}

void MobilityProblem::thermalWrench(const MatrixXd& W, MatrixXd& wrench) {
    if (!bodies.constant) numSquareRoots++;
    if (!matrixFree) {
        if (!bodies.constant) factorise();
        if (bodies.constant) {
            wrench.noalias() = xi.L() * W;
            wrench = (twoRotations(bodies.turns[0]) * wrench).eval();
        } else if (!bodySlips && bodies.motion.isIdentity()) {
            wrench = W;
            M.solveU(wrench);
        } else
            wrench.noalias() = xi.L() * W;
        bodies.nullTwists.removeLift(bodies.turns, wrench);
        return;
    }
    applyRoot(SpectralFunction::inverseSquareRoot(), W, scratch);
    if (bodies.motion.isIdentity())
        wrench = ownScale.asDiagonal() * scratch;
    else
        bodies.getMultiblobSolver().wrenchesFromScaled(scratch, wrench);
    // N = B N_model B^T, so a wrench on the bodies is B^-T times one in the model.
    if (bodies.hasOwnTensors) bodies.multiplyByFactors(wrench, bodies.inverseB_body, true);
}

void MobilityProblem::thermalSlip(const MatrixXd& W, MatrixXd& slips) {
    if (bodySlips) {
        thermalWrench(W, halfSlips);
        solve(halfSlips, slips);
        return;
    }
    numSquareRoots++;
    if (!matrixFree) {
        factorise();
        slips.noalias() = M.L() * W;
        return;
    }
    applyRoot(SpectralFunction::squareRoot(), W, scratch);
    if (bodies.motion.isIdentity())
        slips = ownScale.cwiseInverse().asDiagonal() * scratch;
    else
        bodies.getMultiblobSolver().slipsFromScaled(scratch, slips);
}

void MobilityProblem::multiplyNearby(const vector<Pose>& poses, const MatrixXd& forces, MatrixXd& slips) {
    if (!bodySlips) {
        bodies.particlesNearby(poses).apply(forces, slips);
        bodies.numProducts += forces.cols();
        return;
    }
    here = bodies.poses;
    bodies.setPoses(poses, true);
    if (matrixFree)
        bodies.applyMatrixFree(forces, tolerance, slips);
    else
        slips.noalias() = bodies.mobility() * forces;
    bodies.setPoses(here);
}

void MobilityProblem::rigidSlips(const vector<Pose>& poses, const MatrixXd& twists, MatrixXd& slips) const {
    if (bodySlips || bodies.motion.isIdentity()) {
        slips = twists;
        return;
    }
    setTurns(poses, turns);
    bodies.motion.slips(turns, twists, slips);
}

void MobilityProblem::totalWrenches(const vector<Pose>& poses, const MatrixXd& forces, MatrixXd& wrenches) const {
    if (bodySlips || bodies.motion.isIdentity()) {
        wrenches = forces;
        return;
    }
    setTurns(poses, turns);
    bodies.motion.wrenches(turns, forces, wrenches);
}

void MobilityProblem::nearestTwists(const MatrixXd& slips, MatrixXd& twists) const {
    if (bodySlips || bodies.motion.isIdentity()) {
        twists = slips;
        return;
    }
    twists.setZero(getNumRows(), slips.cols());
    for (size_t e = 0; e < nearest_body.size(); e++) {
        const MatrixXd& nearest = nearest_body[e];
        const Matrix3d& A = bodies.turns[e];
        const int first = bodies.motion.firstParticleRow(e);
        for (int c = 0; c < slips.cols(); c++) {
            auto own = twists.col(c).segment(bodies.firstRow(e), getElements()[e].numRows());
            for (int r = 0; r < nearest.cols(); r += 3)
                own.noalias() += nearest.middleCols<3>(r) * (A.transpose() * slips.col(c).segment<3>(first + r));
            for (int r = 0; r < own.size(); r += 3) own.segment<3>(r) = (A * own.segment<3>(r)).eval();
        }
    }
}

Vector3d MobilityProblem::uniformDivergence() const {
    Vector3d sum = Vector3d::Zero();
    if (!bodies.constant) return sum;
    const Matrix3d coupling = bodies.constantMobility.topRightCorner<3, 3>();
    for (int k = 0; k < 3; k++) sum += Vector3d::Unit(k).cross(Vector3d(coupling.col(k)));
    return bodies.turns[0] * sum;
}

}  // namespace RigidHIPlugin
