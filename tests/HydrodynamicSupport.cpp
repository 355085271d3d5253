#include "HydrodynamicSupport.h"

#include <openmm/HarmonicBondForce.h>
#include <openmm/serialization/XmlSerializer.h>

#include <cmath>

namespace RigidHITest {

Matrix3d cross(const Vector3d& v) {
    Matrix3d m;
    m << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
    return m;
}

MatrixXd pairOfSpheres(double a_i, double a_j, const Vector3d& r, double eta) {
    const double R = r.norm(), sum = a_i + a_j, difference = std::abs(a_i - a_j),
                 largest = std::max(a_i, a_j);
    const Vector3d n = R > 0 ? Vector3d(r / R) : Vector3d::Zero();
    const Matrix3d I = Matrix3d::Identity(), nn = n * n.transpose();
    const double squares = a_i * a_i + a_j * a_j;
    Matrix3d tt, rr;
    /** c of Omega_first = c (F_second x n), n from second to first. */
    const auto c = [&](double first, double second) {
        if (R > sum) return 1 / (8 * M_PI * eta * R * R);
        if (R > difference)
            return std::pow(first - second + R, 2) *
                   (second * second + 2 * second * (first + R) - 3 * std::pow(first - R, 2)) /
                   (8 * R * R) / (16 * M_PI * eta * std::pow(first, 3) * second);
        return first > second ? R / (8 * M_PI * eta * std::pow(first, 3)) : 0.0;
    };
    if (R > sum) {
        tt =
            ((1 + squares / (3 * R * R)) * I + (1 - squares / (R * R)) * nn) / (8 * M_PI * eta * R);
        rr = -(I - 3 * nn) / (16 * M_PI * eta * R * R * R);
    } else if (R > difference) {
        const double d2 = difference * difference, R2 = R * R, R3 = R2 * R;
        tt = ((16 * R3 * sum - std::pow(d2 + 3 * R2, 2)) / (32 * R3) * I +
              3 * std::pow(d2 - R2, 2) / (32 * R3) * nn) /
             (6 * M_PI * eta * a_i * a_j);
        const double A = (5 * R3 * R3 - 27 * R2 * R2 * squares +
                          32 * R3 * (std::pow(a_i, 3) + std::pow(a_j, 3)) -
                          9 * R2 * std::pow(a_i * a_i - a_j * a_j, 2) -
                          d2 * d2 * (squares + 4 * a_i * a_j)) /
                         (64 * R3),
                     B = 3 * std::pow(d2 - R2, 2) * (squares + 4 * a_i * a_j - R2) / (64 * R3);
        rr = (A * I + B * nn) / (8 * M_PI * eta * std::pow(a_i * a_j, 3));
    } else {
        tt = I / (6 * M_PI * eta * largest);
        rr = I / (8 * M_PI * eta * std::pow(largest, 3));
    }
    MatrixXd block(6, 6);
    block << tt, -c(a_j, a_i) * cross(n), -c(a_i, a_j) * cross(n), rr;
    return block;
}

bool LabBody::isLine() const {
    if (radii.size() < 2) return false;
    const Vector3d line = (offsets[1] - offsets[0]).normalized();
    for (const Vector3d& s : offsets)
        if ((s - offsets[0]).cross(line).norm() > 1e-8) return false;
    return true;
}

IndependentMobility::IndependentMobility(const std::vector<LabBody>& bodies, double eta,
                                         const RigidHIPlugin::NoSlipPlane* wall) {
    int particleRows = 0, bodyRows = 0;
    for (const LabBody& body : bodies) {
        particleRows += body.radii.size() * (body.isSphere() ? 6 : 3);
        bodyRows += body.rows();
    }
    MatrixXd M = MatrixXd::Zero(particleRows, particleRows),
             K = MatrixXd::Zero(particleRows, bodyRows);
    int row = 0, bodyRow = 0;
    for (const LabBody& body : bodies) {
        for (size_t i = 0; i < body.radii.size(); i++) {
            const int size = body.isSphere() ? 6 : 3;
            K.block(row, bodyRow, 3, 3).setIdentity();
            if (!body.isFree) K.block(row, bodyRow + 3, 3, 3) = -cross(body.offsets[i]);
            if (body.isSphere()) K.block(row + 3, bodyRow + 3, 3, 3).setIdentity();
            int column = 0;
            for (const LabBody& other : bodies)
                for (size_t k = 0; k < other.radii.size(); k++) {
                    const int otherSize = other.isSphere() ? 6 : 3;
                    const Vector3d r = body.R + body.offsets[i] - other.R - other.offsets[k];
                    M.block(row, column, size, otherSize) =
                        pairOfSpheres(body.radii[i], other.radii[k], r, eta)
                            .topLeftCorner(size, otherSize);
                    column += otherSize;
                }
            row += size;
        }
        bodyRow += body.rows();
    }
    if (wall) {
        RigidHIPlugin::HydrodynamicParticles particles;
        std::vector<Vec3> places;
        for (const LabBody& body : bodies)
            for (size_t i = 0; i < body.radii.size(); i++) {
                particles.add(body.radii[i], body.isSphere(), places.size(), -1);
                const Vector3d r = body.R + body.offsets[i];
                places.push_back(Vec3(r[0], r[1], r[2]));
            }
        RigidHIPlugin::RotnePragerYamakawaWall above(particles, eta, *wall);
        above.at({places})->dense(M);
    }
    const MatrixXd lambda = M.fullPivLu().solve(K);
    friction = K.transpose() * lambda;
    friction = (0.5 * (friction + friction.transpose())).eval();
    MatrixXd allowed = MatrixXd::Identity(bodyRows, bodyRows);  // columns span these twists
    int first = 0, column = 0;
    for (const LabBody& body : bodies) {
        for (int i = 0; i < body.rows(); i++)
            allowed.col(column + i) = VectorXd::Unit(bodyRows, first + i);
        column += body.rows();
        if (body.isLine()) {
            const Vector3d line = (body.offsets.back() - body.offsets[0]).normalized(),
                           across = line.unitOrthogonal();
            allowed.col(column - 3).segment(first + 3, 3) = across;
            allowed.col(column - 2).segment(first + 3, 3) = line.cross(across);
            column--;
        }
        first += body.rows();
    }
    allowed.conservativeResize(bodyRows, column);
    mobility =
        allowed * (allowed.transpose() * friction * allowed).fullPivLu().solve(allowed.transpose());
    following = mobility * lambda.transpose();
}

double difference(const MatrixXd& a, const MatrixXd& b) {
    return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

MatrixXd turned(const MatrixXd& m, const Matrix3d& A) {
    MatrixXd Q = MatrixXd::Zero(m.rows(), m.rows());
    for (int i = 0; i < m.rows(); i += 3) Q.block<3, 3>(i, i) = A;
    return Q * m * Q.transpose();
}

MatrixXd tensorWithoutSymmetry(int seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> u(-1, 1);
    MatrixXd X(6, 6);
    for (int i = 0; i < 36; i++) X(i / 6, i % 6) = u(random);
    MatrixXd tensor = 0.15 * X * X.transpose();
    for (int i = 0; i < 6; i++) tensor(i, i) += i < 3 ? 1 : 2;
    return tensor;
}

MatrixXd squareOf(const std::vector<double>& numbers) {
    const int n = std::lround(std::sqrt(numbers.size()));
    return Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
        numbers.data(), n, n);
}

std::vector<double> rowsOf(const MatrixXd& m) {
    std::vector<double> numbers;
    for (int i = 0; i < m.rows(); i++)
        for (int k = 0; k < m.cols(); k++) numbers.push_back(m(i, k));
    return numbers;
}

Matrix3d rotationOf(const QuaternionArray& q) {
    return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
}

BodyKind sphereKind(double radius, double mass, double moment) {
    return {"sphere", mass, Vec3(moment, moment, moment), {Vec3()}, {radius}};
}

BodyKind boomerangKind() {
    return {"boomerang",
            3,
            Vec3(1.3, 0.7, 1.1),
            {Vec3(0.1, 0, 0), Vec3(0.9, 0.1, 0), Vec3(1.5, -0.3, 0.2), Vec3(0, 0.8, 0.1),
             Vec3(-0.3, 1.4, 0.1)},
            {0.5, 0.4, 0.45, 0.5, 0.3}};
}

BodyKind rodKind() {
    return {"rod",
            2,
            Vec3(0.9, 0.9, 0),
            {Vec3(0, 0, -0.8), Vec3(0, 0, 0.1), Vec3(0, 0, 0.9)},
            {0.4, 0.3, 0.5}};
}

void FluidScene::add(const BodyKind& kind, const Vec3& R, const QuaternionArray& q) {
    std::vector<int> members;
    for (size_t i = 0; i < kind.sites.size(); i++) {
        members.push_back(system.addParticle(kind.mass / kind.sites.size()));
        fluid->addParticle(kind.radii[i]);
        positions.push_back(R + rotate(q, kind.sites[i]));
    }
    integrator.addRigidBody(members, kind.mass, kind.moments, kind.sites);
    bodies.push_back(kind);
    particles.push_back(members);
    places.push_back(R);
    turns.push_back(q);
}

void FluidScene::addFree(double mass, double radius, const Vec3& x) {
    freeParticles.push_back(system.addParticle(mass));
    fluid->addParticle(radius);
    positions.push_back(x);
}

void FluidScene::bind() {
    const double height = boxHeight > 0 ? boxHeight : side;
    system.setDefaultPeriodicBoxVectors(Vec3(side, 0, 0), Vec3(0, side, 0), Vec3(shear, 0, height));
    // OpenMM keeps molecules together, and bonds tell it what the molecules are.
    auto* bonds = new OpenMM::HarmonicBondForce();
    for (const auto& members : particles)
        for (size_t i = 1; i < members.size(); i++) bonds->addBond(members[0], members[i], 1, 0);
    if (bonds->getNumBonds() > 0)
        system.addForce(bonds);
    else
        delete bonds;
}

void FluidScene::start(OpenMM::Platform& platform, int threadCount) {
    if (isPeriodic()) bind();
    context = std::make_unique<OpenMM::Context>(system, integrator, platform,
                                                threads(platform.getName(), threadCount));
    context->setPositions(positions);
    // One site leaves the orientation open.
    if (!bodies.empty()) {
        integrator.setBodyPositions(places);
        integrator.setBodyOrientations(turns);
    }
}

VectorXd FluidScene::state() {
    std::vector<double> numbers;
    for (const auto& rows : {positionsOf(*context), velocitiesOf(*context)})
        for (const Vec3& x : rows) numbers.insert(numbers.end(), {x[0], x[1], x[2]});
    return Eigen::Map<VectorXd>(numbers.data(), numbers.size());
}

void saveState(OpenMM::Context& context, std::stringstream& checkpoint, std::stringstream& xml) {
    using OpenMM::State;
    context.createCheckpoint(checkpoint);
    const State state = context.getState(State::Positions | State::Velocities | State::Parameters |
                                         State::IntegratorParameters);
    OpenMM::XmlSerializer::serialize<State>(&state, "State", xml);
}

void loadState(OpenMM::Context& context, std::stringstream& xml) {
    context.setState(
        *std::unique_ptr<OpenMM::State>(OpenMM::XmlSerializer::deserialize<OpenMM::State>(xml)));
}

MatrixXd FluidScene::mobility() { return squareOf(fluid->getMobilityInContext(*context)); }

MatrixXd FluidScene::friction() { return squareOf(fluid->getFrictionInContext(*context)); }

std::vector<LabBody> FluidScene::labBodies() {
    std::vector<LabBody> result;
    const auto R = integrator.getBodyPositions();
    const auto q = integrator.getBodyOrientations();
    for (size_t b = 0; b < bodies.size(); b++) {
        LabBody body;
        body.R = toEigen(R[b]);
        for (size_t i = 0; i < bodies[b].sites.size(); i++) {
            if (bodies[b].radii[i] == 0) continue;
            body.offsets.push_back(rotationOf(q[b]) * toEigen(bodies[b].sites[i]));
            body.radii.push_back(bodies[b].radii[i]);
        }
        result.push_back(body);
    }
    const auto x = positionsOf(*context);
    for (int p : freeParticles) {
        if (fluid->getParticleRadius(p) == 0) continue;
        LabBody body;
        body.R = toEigen(x[p]);
        body.offsets = {Vector3d::Zero()};
        body.radii = {fluid->getParticleRadius(p)};
        body.isFree = true;
        result.push_back(body);
    }
    return result;
}

IndependentMobility FluidScene::expected(const std::vector<LabBody>& bodies) {
    const RigidHIPlugin::NoSlipPlane wall(
        fluid->getWallHeight(), integrator.getWallRejection() == CustomRigidHIIntegrator::Crossing);
    return IndependentMobility(bodies, fluid->getViscosity(),
                               fluid->getBoundary() == MobilityForce::NoSlipWall ? &wall : nullptr);
}

IndependentMobility FluidScene::expected() { return expected(labBodies()); }

std::vector<Vec3> randomPlaces(int n, double size, double apart, std::mt19937& random) {
    std::uniform_real_distribution<double> u(0, size);
    std::vector<Vec3> places;
    for (int attempts = 0; (int)places.size() < n; attempts++) {
        if (attempts == 1000) {  // too crowded, so begin again
            places.clear();
            attempts = 0;
        }
        const Vec3 x(u(random), u(random), u(random));
        bool fits = true;
        for (const Vec3& y : places) fits = fits && norm(x - y) >= apart;
        if (fits) places.push_back(x);
    }
    return places;
}

std::vector<QuaternionArray> randomTurns(int n, std::mt19937& random) {
    std::vector<QuaternionArray> turns;
    for (int i = 0; i < n; i++) turns.push_back(randomQuaternion(random));
    return turns;
}

}  // namespace RigidHITest
