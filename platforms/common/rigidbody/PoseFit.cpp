#include "rigidbody/PoseFit.h"

#include <Eigen/Geometry>
#include <cmath>

#include "linearalgebra/Decompositions.h"
#include "rigidbody/EigenVec3.h"
#include "rigidbody/PrincipalAxes.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Singular values below this fraction of the largest are rounding of site positions. */
const double rankTolerance = 1e-10;

/** The principal frame of weighted sites about their centre. */
struct Principal {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    Eigen::Vector3d second = Eigen::Vector3d::Zero();  // second moments, descending
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
    int rank = 0;  // 0 a point, 1 a line, 2 anything else

    Principal(const vector<Eigen::Vector3d>& sites, const vector<double>& weights) {
        double total = 0;
        for (size_t i = 0; i < sites.size(); i++) {
            total += weights[i];
            centre += weights[i] * sites[i];
        }
        centre /= total;
        Eigen::MatrixXd scaled(3, sites.size());
        for (size_t i = 0; i < sites.size(); i++)
            scaled.col(i) = sqrt(weights[i]) * (sites[i] - centre);
        const PrincipalAxes principal = principalAxes(scaled);
        const Eigen::Vector3d& values = principal.singularValues;
        if (!(values[0] > 0)) return;
        rank = values[1] > rankTolerance * values[0] ? 2 : 1;
        second = values.cwiseAbs2();
        axes = principal.axes;
    }
};

/**
 * The smallest rotation that takes the direction a to b. Eigen's own function takes the compiler a
 * quarter of a minute.
 */
Eigen::Quaterniond smallestTurn(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    const Eigen::Vector3d from = a.normalized(), to = b.normalized();
    const double twice = (from + to).norm();  // the cosine of half the angle, twice
    Eigen::Quaterniond turn;
    if (twice < 1e-6) {
        // Rounding hides the axis: make half a turn about any perpendicular axis, and then the
        // rest.
        turn.w() = 0;
        turn.vec() = from.unitOrthogonal();
        return smallestTurn(-from, to) * turn;
    }
    turn.w() = twice / 2;
    turn.vec() = from.cross(to) / twice;
    return turn.normalized();
}

/** Horn's quaternion: the rotation that maximises sum w x . (A s), from the correlation sum w x
 * s^T. */
Eigen::Quaterniond bestTurn(const Eigen::Matrix3d& c) {
    Eigen::Matrix4d k;
    const double xx = c(0, 0), yy = c(1, 1), zz = c(2, 2);
    k << xx + yy + zz, c(2, 1) - c(1, 2), c(0, 2) - c(2, 0), c(1, 0) - c(0, 1),  //
        c(2, 1) - c(1, 2), xx - yy - zz, c(0, 1) + c(1, 0), c(0, 2) + c(2, 0),   //
        c(0, 2) - c(2, 0), c(0, 1) + c(1, 0), yy - xx - zz, c(1, 2) + c(2, 1),   //
        c(1, 0) - c(0, 1), c(0, 2) + c(2, 0), c(1, 2) + c(2, 1), zz - xx - yy;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(k);
    const Eigen::Vector4d v = eigen.eigenvectors().col(3);
    return Eigen::Quaterniond(v[0], v[1], v[2], v[3]).normalized();
}

}  // namespace

PoseFit::PoseFit(const BodyGeometry& geometry, const vector<double>& masses,
                 const vector<bool>& isVirtual)
    : weights(masses) {
    for (const Vec3& s : geometry.sites) sites.push_back(toEigen(s));
    vector<double> equal(sites.size());
    double totalMass = 0;
    for (size_t i = 0; i < sites.size(); i++) {
        equal[i] = isVirtual[i] ? 0 : 1;
        totalMass += masses[i];
    }
    const Principal byCount(sites, equal);
    Principal principal = totalMass == 0 ? byCount : Principal(sites, masses);
    if (totalMass == 0 || principal.rank < byCount.rank) {
        weights = equal;
        principal = byCount;
    }
    for (double weight : weights) totalWeight += weight;
    centre_body = principal.centre;
    axes = principal.axes;
    const Eigen::Vector3d& second = principal.second;
    shape = principal.rank == 0 ? Shape::Point : principal.rank == 1 ? Shape::Line : Shape::Spatial;
    inverseMoments.setZero();
    if (shape != Shape::Point)
        inverseMoments << (shape == Shape::Line ? 0 : 1 / (second[1] + second[2])),
            1 / (second[0] + second[2]), 1 / (second[0] + second[1]);
    for (const auto& s : sites) arms.push_back(axes.transpose() * (s - centre_body));
}

bool PoseFit::massesMakeTheBody(const BodyGeometry& geometry, const vector<double>& masses) const {
    return weights == masses && massesMake(geometry, masses);
}

double PoseFit::fitPose(const vector<Vec3>& positions, BodyState& state, int& worst) const {
    const int n = sites.size();
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (int i = 0; i < n; i++) centre += weights[i] * toEigen(positions[i]);
    centre /= totalWeight;
    Eigen::Quaterniond q(state.q[0], state.q[1], state.q[2], state.q[3]);
    if (shape == Shape::Line) {
        Eigen::Vector3d direction = Eigen::Vector3d::Zero();
        for (int i = 0; i < n; i++)
            direction += weights[i] * arms[i][0] * (toEigen(positions[i]) - centre);
        if (direction.norm() > 0) q = smallestTurn(q * axes.col(0), direction) * q;
    } else if (shape == Shape::Spatial) {
        Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
        for (int i = 0; i < n; i++)
            correlation += weights[i] * (toEigen(positions[i]) - centre) *
                           (sites[i] - centre_body).transpose();
        q = bestTurn(correlation);
        // The eigenvector has an error of 1e-16 over the relative thinness of the body.
        // Gauss-Newton steps, which work on small differences, remove this error.
        for (int iteration = 0; iteration < 2; iteration++) {
            const Eigen::Matrix3d toPrincipal = (q.toRotationMatrix() * axes).transpose();
            Eigen::Vector3d moment = Eigen::Vector3d::Zero();
            for (int i = 0; i < n; i++)
                moment += weights[i] *
                          arms[i].cross(toPrincipal * (toEigen(positions[i]) - centre) - arms[i]);
            const Eigen::Vector3d turn_body = axes * moment.cwiseProduct(inverseMoments);
            q = q * Eigen::Quaterniond(1, turn_body[0] / 2, turn_body[1] / 2, turn_body[2] / 2);
            q.normalize();
        }
    }
    q.normalize();
    // Take whichever of q and -q is nearer to the last orientation, so that orientations stay
    // continuous.
    if (q.w() * state.q[0] + q.x() * state.q[1] + q.y() * state.q[2] + q.z() * state.q[3] < 0)
        q.coeffs() = -q.coeffs();
    const Eigen::Matrix3d A = q.toRotationMatrix();
    const Eigen::Vector3d R = centre - A * centre_body;
    state.R = toVec3(R);
    state.q = {{q.w(), q.x(), q.y(), q.z()}};
    double largest = -1;
    for (int i = 0; i < n; i++) {
        const double distance = (toEigen(positions[i]) - R - A * sites[i]).norm();
        if (!(distance <= largest)) {
            largest = distance;
            worst = i;
        }
    }
    return largest;
}

void PoseFit::fitTwist(const vector<Vec3>& velocities, const BodyState& state, Vec3& velocity,
                       Vec3& omega_lab) const {
    const Eigen::Matrix3d A = Eigen::Quaterniond(state.q[0], state.q[1], state.q[2], state.q[3])
                                  .normalized()
                                  .toRotationMatrix();
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (size_t i = 0; i < sites.size(); i++) mean += weights[i] * toEigen(velocities[i]);
    mean /= totalWeight;
    const Eigen::Matrix3d toPrincipal = (A * axes).transpose();
    Eigen::Vector3d moment = Eigen::Vector3d::Zero();
    for (size_t i = 0; i < sites.size(); i++)
        moment += weights[i] * arms[i].cross(toPrincipal * (toEigen(velocities[i]) - mean));
    Eigen::Vector3d omega = moment.cwiseProduct(inverseMoments);
    const Eigen::Vector3d old = toPrincipal * toEigen(omega_lab);
    for (int k = 0; k < 3; k++)
        if (inverseMoments[k] == 0) omega[k] = old[k];
    omega_lab = toVec3(toPrincipal.transpose() * omega);
    velocity = toVec3(mean - A * (axes * omega).cross(centre_body));
}

}  // namespace RigidHIPlugin
