#include "mobility/BodyMobility.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <sstream>

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

typedef Matrix<double, 6, 6> Matrix6d;

MatrixXd symmetricPower(const MatrixXd& matrix, double power) {
    const SelfAdjointEigenSolver<MatrixXd> solver(matrix);
    return solver.eigenvectors() * solver.eigenvalues().array().pow(power).matrix().asDiagonal() *
           solver.eigenvectors().transpose();
}

vector<int> firstRows(const RigidMotion& motion) {
    vector<int> rows;
    for (size_t e = 0; e < motion.getElements().size(); e++) rows.push_back(motion.firstRow(e));
    return rows;
}

}  // namespace

BodyMobility::BodyMobility(const vector<FluidElement>& elements, const ModelFactory& makeModel, bool mayBeConstant)
    : motion(elements), nullTwists(firstRows(motion)) {
    const HydrodynamicParticles& particles = motion.getParticles();
    if (particles.size() > 0) model = makeModel(particles);
    aloneInUniformFluid =
        mayBeConstant && elements.size() == 1 && (!model || (model->isHomogeneous() && model->isIsotropic()));
    constant = aloneInUniformFluid && !elements[0].isFree();
    B_body.resize(elements.size());
    inverseB_body.resize(elements.size());
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const bool hasOwnTensor = element.ownMobility.size() > 0;
        hasOwnTensors = hasOwnTensors || hasOwnTensor;
        // A tensor that is taken as it is holds the body about its line too.
        if (element.particles.size() > 1 && !(constant && hasOwnTensor)) {
            checkSites(e);
            nullTwists.find(e, element.sites);
        }
        if (hasOwnTensor && hasNullVector(e))
            throw OpenMM::OpenMMException(
                "MobilityForce: body " + to_string(element.body) +
                " was given a tensor of its own, but its hydrodynamic particles lie on a line: the model has no "
                "mobility about the line that the tensor could be combined with; give only one of them a radius, or "
                "use FreeDraining");
    }
    placesInFormulas.resize(particles.size());
    if (!constant)
        for (size_t e = 0; e < elements.size(); e++) {
            if (elements[e].ownMobility.size() == 0) continue;
            B_body[e] = symmetricPower(elements[e].ownMobility, 0.5) * symmetricPower(ownModelMobility(e), -0.5);
            inverseB_body[e] = B_body[e].inverse();
        }
    if (constant) {
        if (elements[0].ownMobility.size() > 0) {
            constantMobility = elements[0].ownMobility;
            constantFriction = constantMobility.inverse();
        } else {
            constant = false;
            setPoses({Pose()});
            constantMobility = mobility();
            constantFriction = friction();
            constant = true;
        }
    }
}

bool BodyMobility::prefersFriction() const { return !motion.isIdentity() || (model && model->isMadeFromFriction()); }

/** What the model makes of a body by itself in unbounded fluid, body frame. */
MatrixXd BodyMobility::ownModelMobility(int e) const {
    const FluidElement& element = getElements()[e];
    MatrixXd M;
    model->ownMobility(particlesOf({element}), sitesOf(element), M);
    if (RigidMotion({element}).isIdentity()) return M;
    MatrixXd K = motion.ofElement_body(e);
    CholeskyFactor factor;
    if (!factor.compute(M)) refuseIndefiniteMobility(element.particles.size());
    factor.solveL(K);
    MatrixXd xi(6, 6);
    xi.noalias() = K.transpose() * K;
    return generalisedInverse(0.5 * (xi + xi.transpose()), VectorXd());
}

/** The sites of a body's blobs are constant: this is known once for all. */
void BodyMobility::checkSites(int e) {
    const FluidElement& element = getElements()[e];
    coincidence.check(particlesOf({element}), sitesOf(element), 1);
    // Blobs of different radii at one place have a mobility, but forces on them cannot turn the body.
    double largestRadius = 0, size = 0;
    for (size_t i = 0; i < element.sites.size(); i++) {
        largestRadius = max(largestRadius, element.radii[i]);
        size = max(size, (element.sites[i] - element.sites[0]).norm());
    }
    if (size > CoincidenceCheck::bound * largestRadius) return;
    ostringstream text;
    text << "MobilityForce: body " << element.body << ": its " << element.sites.size()
         << " hydrodynamic particles are all at one place, within " << size
         << " nm; blobs that are nearer than 1e-6 of their radius, here " << CoincidenceCheck::bound * largestRadius
         << " nm, do not resist rotation: give all but one the radius 0, which makes the body a sphere, or other sites";
    throw OpenMM::OpenMMException(text.str());
}

void BodyMobility::checkPlaces() {
    const double roomForRounding = 0.5;
    const HydrodynamicParticles& particles = motion.getParticles();
    bool lifted = false;
    for (int i = 0; i < particles.size(); i++) {
        placesInFormulas[i] = model->placeInFormulas(i, placement.positions[i]);
        lifted = lifted || placesInFormulas[i] != placement.positions[i];
    }
    // Blobs of one body alone keep their distances, which are known.
    if (getElements().size() > 1 || lifted) coincidence.check(particles, placesInFormulas, roomForRounding);
}

void BodyMobility::setPoses(const vector<Pose>& newPoses, bool nearby) {
    poses = newPoses;
    setTurns(poses, turns);
    mobilityIsKnown = frictionIsKnown = false;
    if (constant) return;
    placement.box = box;
    motion.place(poses, turns, placement);
    if (nearby) {
        model->placeNear(here, placement);
        return;
    }
    model->place(here, placement);
    checkPlaces();
}

MobilityAt& BodyMobility::particlesNearby(const vector<Pose>& at) {
    setTurns(at, turnsNearby);
    placement.box = box;
    motion.place(at, turnsNearby, placement);
    model->placeNear(elsewhere, placement);
    return *elsewhere;
}

Placement BodyMobility::placementOf(const vector<Pose>& at) const {
    vector<Matrix3d> turnsThere;
    setTurns(at, turnsThere);
    Placement result;
    result.box = box;
    motion.place(at, turnsThere, result);
    return result;
}

bool BodyMobility::acceptsNearby(const vector<Pose>& at) const {
    return !mayObject() || model->acceptsNearby(placementOf(at));
}

string BodyMobility::objection(const vector<Pose>& at) const {
    return mayObject() ? model->objection(placementOf(at)) : string();
}

/** matrix = D(F) matrix D(F)^T, with the block-diagonal D of the factors turned into the lab frame (or of F^T). */
void BodyMobility::congruence(MatrixXd& matrix, const vector<MatrixXd>& factors_body, bool transposed) const {
    for (size_t e = 0; e < factors_body.size(); e++) {
        if (factors_body[e].size() == 0) continue;
        const Matrix6d turn = twoRotations(turns[e]);
        Matrix6d factor = turn * factors_body[e] * turn.transpose();
        if (transposed) factor.transposeInPlace();
        matrix.middleRows<6>(motion.firstRow(e)) = (factor * matrix.middleRows<6>(motion.firstRow(e))).eval();
        matrix.middleCols<6>(motion.firstRow(e)) =
            (matrix.middleCols<6>(motion.firstRow(e)) * factor.transpose()).eval();
    }
}

void BodyMobility::multiplyByFactors(MatrixXd& vectors, const vector<MatrixXd>& factors_body, bool transposed) const {
    for (size_t e = 0; e < factors_body.size(); e++) {
        if (factors_body[e].size() == 0) continue;
        const Matrix6d turn = twoRotations(turns[e]);
        Matrix6d factor = turn * factors_body[e] * turn.transpose();
        if (transposed) factor.transposeInPlace();
        vectors.middleRows<6>(motion.firstRow(e)) = (factor * vectors.middleRows<6>(motion.firstRow(e))).eval();
    }
}

/** xi = K^T M^-1 K, before own tensors. */
void BodyMobility::computeFriction() {
    if (motion.isIdentity()) {
        here->friction(xi);
        return;
    }
    motion.fill(turns, K);
    if (model->isMadeFromFriction()) {
        here->friction(M);
        xi.noalias() = K.transpose() * M * K;
    } else {
        here->dense(M);
        if (!factor.compute(M)) refuseIndefiniteMobility(motion.getParticles().size());
        factor.solveL(K);
        xi.noalias() = K.transpose() * K;
    }
    xi = (0.5 * (xi + xi.transpose())).eval();
}

const MatrixXd& BodyMobility::friction() {
    if (frictionIsKnown) return xi;
    if (constant) {
        const Matrix6d turn = twoRotations(turns[0]);
        xi = turn * constantFriction * turn.transpose();
    } else {
        numMatrices++;
        computeFriction();
        if (hasOwnTensors) congruence(xi, inverseB_body, true);
    }
    frictionIsKnown = true;
    return xi;
}

const MatrixXd& BodyMobility::mobility() {
    if (mobilityIsKnown) return N;
    if (constant) {
        const Matrix6d turn = twoRotations(turns[0]);
        N = turn * constantMobility * turn.transpose();
    } else if (motion.isIdentity()) {
        numMatrices++;
        here->dense(N);
        if (hasOwnTensors) congruence(N, B_body, false);
    } else {
        scratch = friction();
        nullTwists.lift(turns, scratch);
        const LLT<MatrixXd> factor(scratch);
        if (factor.info() != Success) refuseIndefiniteFriction(getElements().size());
        N = factor.solve(MatrixXd::Identity(getNumRows(), getNumRows()));
        nullTwists.project(turns, N);
        N = (0.5 * (N + N.transpose())).eval();
    }
    mobilityIsKnown = true;
    return N;
}

MultiblobSolver& BodyMobility::getMultiblobSolver() {
    if (!multiblobSolver) multiblobSolver.reset(new MultiblobSolver(motion, nullTwists, *model));
    multiblobSolver->wantedTolerance = wantedTolerance;
    multiblobSolver->setTurns(turns);
    return *multiblobSolver;
}

double BodyMobility::length(int e) const {
    const FluidElement& element = getElements()[e];
    double longest = 0;
    for (size_t i = 0; i < element.sites.size(); i++)
        for (size_t k = 0; k <= i; k++)
            longest = max(longest, (element.sites[i] - element.sites[k]).norm() + element.radii[i] + element.radii[k]);
    return longest > 0 ? longest : 1;
}

void BodyMobility::apply(const MatrixXd& wrenches, MatrixXd& twists) {
    const double tightTolerance = 1e-12;
    if (constant || !multipliesWithoutIterations() || mobilityIsKnown)
        twists.noalias() = mobility() * wrenches;
    else
        applyMatrixFree(wrenches, tightTolerance, twists);
}

void BodyMobility::applyMatrixFree(const MatrixXd& wrenches, double tolerance, MatrixXd& twists,
                                   double toleranceOfProducts) {
    const MatrixXd* forces = &wrenches;
    if (hasOwnTensors) {
        scratch = wrenches;
        multiplyByFactors(scratch, B_body, true);
        forces = &scratch;
    }
    if (motion.isIdentity()) {
        here->applyFor(toleranceOfProducts, *forces, twists);
        numProducts += wrenches.cols();
    } else {
        const int iterations = getMultiblobSolver().apply(*here, *forces, tolerance, twists);
        numSolverIterations += iterations;
        numProducts += (iterations + 1) * wrenches.cols();
    }
    if (hasOwnTensors) multiplyByFactors(twists, B_body, false);
}

void BodyMobility::applyToParticles(const VectorXd& forces, VectorXd& velocities) {
    const HydrodynamicParticles& particles = motion.getParticles();
    if (particles.size() == 0) return;
    if (constant) {
        // Where the tensor is known, setPoses() has no need of the particles.
        placement.box = box;
        motion.place(poses, turns, placement);
        model->place(here, placement);
    }
    MatrixXd f = MatrixXd::Zero(particles.numRows, 1), u;
    for (int i = 0; i < particles.size(); i++)
        f.middleRows<3>(particles.firstRow[i]) = forces.segment<3>(3 * particles.systemIndex[i]);
    here->apply(f, u);
    numProducts += model->hasProducts();
    for (int i = 0; i < particles.size(); i++)
        velocities.segment<3>(3 * particles.systemIndex[i]) = u.middleRows<3>(particles.firstRow[i]);
}

MatrixXd BodyMobility::mobilityByIterations(double tolerance) {
    // So many columns share what products compute of each pair; more take memory only.
    const int batch = 24;
    const int numRows = getNumRows();
    MatrixXd result(numRows, numRows), wrenches, twists;
    for (int first = 0; first < numRows; first += batch) {
        const int count = min(batch, numRows - first);
        wrenches.setZero(numRows, count);
        wrenches.middleRows(first, count).setIdentity();
        applyMatrixFree(wrenches, tolerance, twists);
        result.middleCols(first, count) = twists;
    }
    return 0.5 * (result + result.transpose());
}

}  // namespace RigidHIPlugin
