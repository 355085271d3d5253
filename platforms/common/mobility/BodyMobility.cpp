#include "mobility/BodyMobility.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <sstream>

#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

typedef Matrix<double, 6, 6> Matrix6d;

/** Blobs nearer to a line than this, relative to the body's size, are on it: coordinates are rarely given to more digits. */
const double lineTolerance = 1e-9;

Matrix3d crossMatrix(const Vector3d& r) {
    Matrix3d m;
    m << 0, -r.z(), r.y(), r.z(), 0, -r.x(), -r.y(), r.x(), 0;
    return m;
}

/** The twist about a line that leaves all sites where they are, or an empty vector if they are not on one line. */
VectorXd twistAboutLine(const vector<Vector3d>& sites) {
    Vector3d centre = Vector3d::Zero();
    for (const Vector3d& s : sites) centre += s / sites.size();
    MatrixXd spread(3, sites.size());
    for (size_t i = 0; i < sites.size(); i++) spread.col(i) = sites[i] - centre;
    const SelfAdjointEigenSolver<Matrix3d> solver(spread * spread.transpose());
    const Vector3d line = solver.eigenvectors().col(2);
    for (size_t i = 0; i < sites.size(); i++)
        if (Vector3d(spread.col(i)).cross(line).norm() > lineTolerance * spread.norm()) return VectorXd();
    VectorXd twist(6);
    twist << -line.cross(centre), line;
    return twist / twist.norm();
}

MatrixXd symmetricPower(const MatrixXd& matrix, double power) {
    const SelfAdjointEigenSolver<MatrixXd> solver(matrix);
    return solver.eigenvectors() * solver.eigenvalues().array().pow(power).matrix().asDiagonal() *
           solver.eigenvectors().transpose();
}

}  // namespace

Matrix6d twoRotations(const Matrix3d& A) {
    Matrix6d both = Matrix6d::Zero();
    both.topLeftCorner<3, 3>() = both.bottomRightCorner<3, 3>() = A;
    return both;
}

/** K of one element at a place in a larger matrix of zeros. */
static void placeRigidMotion(const FluidElement& element, const Matrix3d& A, MatrixXd& K, int row, int column) {
    for (const Vector3d& site : element.sites) {
        K.block<3, 3>(row, column).setIdentity();
        if (!element.isFree()) K.block<3, 3>(row, column + 3) = -crossMatrix(A * site);
        if (element.isSphere()) K.block<3, 3>(row + 3, column + 3).setIdentity();
        row += 3;
    }
}

MatrixXd rigidMotion(const FluidElement& element, const Matrix3d& A) {
    MatrixXd K = MatrixXd::Zero((element.isSphere() ? 6 : 3) * element.sites.size(), element.numRows());
    placeRigidMotion(element, A, K, 0, 0);
    return K;
}

void removeTurnAboutLine(const Matrix<double, 6, 1>& n, Ref<MatrixXd> twists) {
    const Vector3d line = n.tail<3>();
    for (int c = 0; c < twists.cols(); c++) twists.col(c) -= line.dot(twists.col(c).tail<3>()) / line.squaredNorm() * n;
}

void removeTorqueAboutLine(const Matrix<double, 6, 1>& n, Ref<MatrixXd> wrenches) {
    const Vector3d line = n.tail<3>();
    for (int c = 0; c < wrenches.cols(); c++)
        wrenches.col(c).tail<3>() -= n.dot(wrenches.col(c)) / line.squaredNorm() * line;
}

MatrixXd generalisedInverse(const MatrixXd& friction, const VectorXd& nullVector) {
    MatrixXd lifted = friction;
    const double lift = friction.trace() / friction.rows();
    if (nullVector.size() > 0) lifted += lift * nullVector * nullVector.transpose();
    MatrixXd inverse = lifted.llt().solve(MatrixXd::Identity(friction.rows(), friction.cols()));
    if (nullVector.size() > 0) {
        removeTurnAboutLine(nullVector, inverse);
        inverse.transposeInPlace();
        removeTurnAboutLine(nullVector, inverse);
    }
    return 0.5 * (inverse + inverse.transpose());
}

HydrodynamicParticles particlesOf(const vector<FluidElement>& elements) {
    HydrodynamicParticles particles;
    for (const FluidElement& element : elements)
        for (size_t i = 0; i < element.particles.size(); i++)
            particles.add(element.radii[i], element.isSphere(), element.particles[i], element.body);
    return particles;
}

BodyMobility::BodyMobility(const vector<FluidElement>& elements, const ModelFactory& makeModel, bool mayBeConstant)
    : elements(elements), particles(particlesOf(elements)) {
    if (particles.size() > 0) model = makeModel(particles);
    aloneInUniformFluid =
        mayBeConstant && elements.size() == 1 && (!model || (model->isHomogeneous() && model->isIsotropic()));
    constant = aloneInUniformFluid && !elements[0].isFree();
    nullVectors.resize(elements.size());
    B_body.resize(elements.size());
    inverseB_body.resize(elements.size());
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        rows.push_back(numRows);
        numRows += element.numRows();
        firstParticle.push_back(e == 0 ? 0 : firstParticle.back() + elements[e - 1].particles.size());
        if (!element.isFree() && (element.particles.size() != 1 || !element.sites[0].isZero(0))) identityK = false;
        const bool hasOwnTensor = element.ownMobility.size() > 0;
        hasOwnTensors = hasOwnTensors || hasOwnTensor;
        // A tensor that is taken as it is holds the body about its line too.
        if (element.particles.size() > 1 && !(constant && hasOwnTensor)) {
            checkSites(e);
            nullVectors[e] = twistAboutLine(element.sites);
        }
        if (hasOwnTensor && hasNullVector(e))
            throw OpenMM::OpenMMException(
                "MobilityForce: body " + to_string(element.body) +
                " was given a tensor of its own, but its hydrodynamic particles lie on a line: the model has no "
                "mobility about the line that the tensor could be combined with; give only one of them a radius, or "
                "use FreeDraining");
    }
    placement.positions.resize(particles.size());
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

bool BodyMobility::prefersFriction() const { return !identityK || (model && model->isMadeFromFriction()); }

/** What the model makes of a body by itself in unbounded fluid, body frame. */
MatrixXd BodyMobility::ownModelMobility(int e) const {
    const FluidElement& element = elements[e];
    vector<OpenMM::Vec3> sites;
    for (const Vector3d& site : element.sites) sites.push_back(toVec3(site));
    MatrixXd M;
    model->ownMobility(particlesOf({element}), sites, M);
    if (element.particles.size() == 1 && element.sites[0].isZero(0)) return M;
    MatrixXd K = rigidMotion(element, Matrix3d::Identity());
    CholeskyFactor factor;
    if (!factor.compute(M)) refuseIndefiniteMobility(element.particles.size());
    factor.solveL(K);
    MatrixXd xi(6, 6);
    xi.noalias() = K.transpose() * K;
    return generalisedInverse(0.5 * (xi + xi.transpose()), VectorXd());
}

/** The sites of a body's blobs are constant: this is known once for all. */
void BodyMobility::checkSites(int e) {
    const HydrodynamicParticles own = particlesOf({elements[e]});
    vector<OpenMM::Vec3> places;
    for (const Vector3d& site : elements[e].sites) places.push_back(OpenMM::Vec3(site.x(), site.y(), site.z()));
    coincidence.check(own, places, 1);
    // Blobs of different radii at one place have a mobility, but forces on them cannot turn the body.
    double largestRadius = 0, size = 0;
    for (size_t i = 0; i < places.size(); i++) {
        largestRadius = max(largestRadius, elements[e].radii[i]);
        size = max(size, (elements[e].sites[i] - elements[e].sites[0]).norm());
    }
    if (size > CoincidenceCheck::bound * largestRadius) return;
    ostringstream text;
    text << "MobilityForce: body " << elements[e].body << ": its " << places.size()
         << " hydrodynamic particles are all at one place, within " << size
         << " nm; blobs that are nearer than 1e-6 of their radius, here " << CoincidenceCheck::bound * largestRadius
         << " nm, do not resist rotation: give all but one the radius 0, which makes the body a sphere, or other sites";
    throw OpenMM::OpenMMException(text.str());
}

void BodyMobility::checkPlaces() {
    const double roomForRounding = 0.5;
    for (int i = 0; i < particles.size(); i++) placesInFormulas[i] = model->placeInFormulas(i, placement.positions[i]);
    coincidence.check(particles, placesInFormulas, roomForRounding);
}

void BodyMobility::setPoses(const vector<Pose>& newPoses, bool nearby) {
    poses = newPoses;
    mobilityIsKnown = frictionIsKnown = false;
    if (constant) return;
    placeParticles(poses, placement);
    if (nearby) {
        model->placeNear(here, placement);
        return;
    }
    model->place(here, placement);
    checkPlaces();
}

MobilityAt& BodyMobility::particlesNearby(const vector<Pose>& at) {
    placeParticles(at, placement);
    model->placeNear(elsewhere, placement);
    return *elsewhere;
}

void BodyMobility::placeParticles(const vector<Pose>& at, Placement& to) const {
    to.box = box;
    for (size_t e = 0; e < elements.size(); e++)
        for (size_t i = 0; i < elements[e].sites.size(); i++) {
            const Vector3d r = at[e].R + at[e].A * elements[e].sites[i];
            to.positions[firstParticle[e] + i] = OpenMM::Vec3(r.x(), r.y(), r.z());
        }
}

Placement BodyMobility::placementOf(const vector<Pose>& at) const {
    Placement result;
    result.positions.resize(particles.size());
    placeParticles(at, result);
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
    for (size_t e = 0; e < elements.size(); e++) {
        if (factors_body[e].size() == 0) continue;
        const Matrix6d turn = twoRotations(poses[e].A);
        Matrix6d factor = turn * factors_body[e] * turn.transpose();
        if (transposed) factor.transposeInPlace();
        matrix.middleRows<6>(rows[e]) = (factor * matrix.middleRows<6>(rows[e])).eval();
        matrix.middleCols<6>(rows[e]) = (matrix.middleCols<6>(rows[e]) * factor.transpose()).eval();
    }
}

void BodyMobility::multiplyByFactors(MatrixXd& vectors, const vector<MatrixXd>& factors_body, bool transposed) const {
    for (size_t e = 0; e < elements.size(); e++) {
        if (factors_body[e].size() == 0) continue;
        const Matrix6d turn = twoRotations(poses[e].A);
        Matrix6d factor = turn * factors_body[e] * turn.transpose();
        if (transposed) factor.transposeInPlace();
        vectors.middleRows<6>(rows[e]) = (factor * vectors.middleRows<6>(rows[e])).eval();
    }
}

/** xi = K^T M^-1 K, before own tensors. */
void BodyMobility::computeFriction() {
    if (identityK) {
        here->friction(xi);
        return;
    }
    fillK(poses, K);
    if (model->isMadeFromFriction()) {
        here->friction(M);
        xi.noalias() = K.transpose() * M * K;
    } else {
        here->dense(M);
        if (!factor.compute(M)) refuseIndefiniteMobility(particles.size());
        factor.solveL(K);
        xi.noalias() = K.transpose() * K;
    }
    xi = (0.5 * (xi + xi.transpose())).eval();
}

const MatrixXd& BodyMobility::friction() {
    if (frictionIsKnown) return xi;
    if (constant) {
        const Matrix6d turn = twoRotations(poses[0].A);
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
        const Matrix6d turn = twoRotations(poses[0].A);
        N = turn * constantMobility * turn.transpose();
    } else if (identityK) {
        numMatrices++;
        here->dense(N);
        if (hasOwnTensors) congruence(N, B_body, false);
    } else {
        // Null vectors n are given the friction `lift`, which Q takes away again after the inversion: Q n = 0.
        scratch = friction();
        const double lift = scratch.trace() / numRows;
        vector<VectorXd> nulls(elements.size());
        for (size_t e = 0; e < elements.size(); e++)
            if (hasNullVector(e)) {
                nulls[e] = twoRotations(poses[e].A) * nullVectors[e];
                scratch.block<6, 6>(rows[e], rows[e]) += lift * nulls[e] * nulls[e].transpose();
            }
        const LLT<MatrixXd> factor(scratch);
        if (factor.info() != Success) refuseIndefiniteFriction(elements.size());
        N = factor.solve(MatrixXd::Identity(numRows, numRows));
        for (size_t e = 0; e < elements.size(); e++)
            if (hasNullVector(e)) {
                removeTurnAboutLine(nulls[e], N.middleRows<6>(rows[e]));
                MatrixXd own = N.block<6, 6>(rows[e], rows[e]).transpose();
                removeTurnAboutLine(nulls[e], own);
                N.middleCols<6>(rows[e]) = N.middleRows<6>(rows[e]).transpose().eval();
                N.block<6, 6>(rows[e], rows[e]) = own;
            }
        N = (0.5 * (N + N.transpose())).eval();
    }
    mobilityIsKnown = true;
    return N;
}

MultiblobSolver& BodyMobility::getMultiblobSolver() {
    if (!multiblobSolver)
        multiblobSolver.reset(new MultiblobSolver(elements, rows, firstParticle, particles, nullVectors, *model));
    multiblobSolver->wantedTolerance = wantedTolerance;
    multiblobSolver->setPoses(poses);
    return *multiblobSolver;
}

/** K of all elements; without allocation if it has its size already. */
void BodyMobility::fillK(const vector<Pose>& at, MatrixXd& matrix) const {
    matrix.setZero(particles.numRows, numRows);
    for (size_t e = 0; e < elements.size(); e++)
        placeRigidMotion(elements[e], at[e].A, matrix, particles.firstRow[firstParticle[e]], rows[e]);
}

double BodyMobility::length(int e) const {
    const FluidElement& element = elements[e];
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
    if (identityK) {
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
    if (particles.size() == 0) return;
    if (constant) {
        // Where the tensor is known, setPoses() has no need of the particles.
        placeParticles(poses, placement);
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
