#include "rigidbody/BodyGeometry.h"

#include <openmm/OpenMMException.h>

#include <Eigen/SVD>
#include <algorithm>
#include <functional>
#include <map>
#include <numeric>

#include "linearalgebra/Decompositions.h"
#include "openmmrigidhi/internal/Messages.h"
#include "rigidbody/EigenVec3.h"
#include "rigidbody/PrincipalAxes.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Principal axes as columns (right-handed) and moments in ascending order, about the centre of
 * mass. */
struct PrincipalFrame {
    Vec3 centre, moments;
    Eigen::Matrix3d axes;
    double mass = 0;
    PrincipalFrame(const vector<double>& masses, const vector<Vec3>& x) {
        for (size_t i = 0; i < x.size(); i++) {
            mass += masses[i];
            centre += x[i] * masses[i];
        }
        centre /= mass;
        // The second-moment tensor has the same axes as the inertia tensor, and keeps the thin
        // directions of needles accurate. The inertia tensor would subtract large numbers there.
        Eigen::MatrixXd scaled(3, x.size());
        for (size_t i = 0; i < x.size(); i++)
            scaled.col(i) = sqrt(masses[i]) * toEigen(x[i] - centre);
        const PrincipalAxes principal = principalAxes(scaled);
        const Eigen::Vector3d second = principal.singularValues.cwiseAbs2();  // axis 0: the longest
        moments = Vec3(second[1] + second[2], second[0] + second[2], second[0] + second[1]);
        axes = principal.axes;
    }
    Vec3 toBody(const Vec3& x) const { return toVec3(axes.transpose() * toEigen(x - centre)); }
    Vec3 toOutside(const Vec3& s) const { return toVec3(axes * toEigen(s)) + centre; }
};

/**
 * The relative tolerance within which a shape must have the lengths of its constraints: force
 * fields give six digits.
 */
const double constraintTolerance = 1e-6;
/** The tolerance of a virtual site's position, relative to the body's size: far above rounding. */
const double virtualSiteTolerance = 1e-9;

}  // namespace

BodyInertia liveInertia(double mass, const Vec3& moments) {
    BodyInertia inertia;
    inertia.mass = mass;
    const double largest = max(moments[0], max(moments[1], moments[2]));
    for (int k = 0; k < 3; k++)
        inertia.moments[k] = moments[k] > zeroMomentFraction * largest ? moments[k] : 0;
    return inertia;
}

bool massesMake(const BodyGeometry& geometry, const vector<double>& masses) {
    const double tolerance = 1e-10;
    const BodyInertia live = liveInertia(geometry.mass, geometry.moments);
    const double largest = max(live.moments[0], max(live.moments[1], live.moments[2]));
    double total = 0;
    Vec3 centre;
    Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
    for (size_t i = 0; i < masses.size(); i++) {
        const Eigen::Vector3d site = toEigen(geometry.sites[i]);
        total += masses[i];
        centre += geometry.sites[i] * masses[i];
        second += masses[i] * site * site.transpose();
    }
    if (abs(total - geometry.mass) > tolerance * geometry.mass) return false;
    for (int k = 0; k < 3; k++) {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        const double moment = second(a, a) + second(b, b);
        if (abs(moment - live.moments[k]) >
            tolerance * (live.isLive(k) ? live.moments[k] : largest))
            return false;
        // Off-diagonal elements couple two axes, so they are compared with the moments of both.
        if (second(a, b) * second(a, b) > tolerance * tolerance *
                                              max(live.moments[a], tolerance * largest) *
                                              max(live.moments[b], tolerance * largest))
            return false;
    }
    return centre.dot(centre) <= tolerance * tolerance * largest * total;
}

ConstraintsOfParticles::ConstraintsOfParticles(const System& system)
    : first(system.getNumParticles() + 1, 0) {
    const auto forEnds = [&](auto action) {
        for (int c = 0; c < system.getNumConstraints(); c++) {
            int a, b;
            double distance;
            system.getConstraintParameters(c, a, b, distance);
            action(a, c);
            action(b, c);
        }
    };
    forEnds([&](int particle, int) { first[particle + 1]++; });
    partial_sum(first.begin(), first.end(), first.begin());
    constraints.resize(first.back());
    vector<int> next(first);
    forEnds([&](int particle, int constraint) { constraints[next[particle]++] = constraint; });
}

BodyGeometryBuilder::BodyGeometryBuilder(const System& system,
                                         const ConstraintsOfParticles& constraints,
                                         const vector<int>& particles, const string& name)
    : system(system), particles(particles), name(name), fixedByConstraints(true),
      hasOtherMassless(false) {
    map<int, int> placeOfParticle;
    for (size_t i = 0; i < particles.size(); i++) {
        const double mass = system.getParticleMass(particles[i]);
        if (mass > 0) {
            placeOfParticle[particles[i]] = massive.size();
            massive.push_back(i);
            masses.push_back(mass);
        } else if (!system.isVirtualSite(particles[i]))
            hasOtherMassless = true;
    }
    if (massive.empty()) {
        // A body without mass is for schemes without momenta. Its frame is the frame of equal
        // weights.
        massless = true;
        fixedByConstraints = hasOtherMassless = false;
        for (size_t i = 0; i < particles.size(); i++)
            if (!system.isVirtualSite(particles[i])) massive.push_back(i);
        masses.assign(massive.size(), 1.0);
        return;
    }
    const size_t n = massive.size();
    map<pair<int, int>, double> distanceOf;  // of pairs; the larger index first
    for (const auto& place : placeOfParticle)
        constraints.forEach(place.first, [&](int c) {
            int a, b;
            double distance;
            system.getConstraintParameters(c, a, b, distance);
            const auto ia = placeOfParticle.find(a), ib = placeOfParticle.find(b);
            if (ia == placeOfParticle.end() || ib == placeOfParticle.end() || distance == 0) return;
            distanceOf[minmax(ia->second, ib->second, greater<int>())] = distance;
        });
    // The matrix of a large body would be larger than all other data, so it is made only if all
    // distances are known.
    fixedByConstraints = distanceOf.size() == n * (n - 1) / 2;
    if (!fixedByConstraints) return;
    distances.assign(n, vector<double>(n, 0.0));
    for (const auto& entry : distanceOf)
        distances[entry.first.first][entry.first.second] =
            distances[entry.first.second][entry.first.first] = entry.second;
}

bool BodyGeometryBuilder::needsPositions() const {
    // Distances do not determine the handedness of four and more points.
    return !fixedByConstraints || hasOtherMassless || massive.size() > 3;
}

bool BodyGeometryBuilder::hasRedundantConstraints() const {
    if (!isFixedByConstraints()) return false;
    const int n = massive.size();
    if (n != 3 && n != 4) return n > 4;
    // The squared determinant of the directions from the last member to the others is 0 on a line
    // or in a plane. Below this bound, for nearly flat shapes too, applyConstraints() failed from
    // positions that were 0.003 nm off.
    const double flat = 1e-3;
    Eigen::MatrixXd cosines(n - 1, n - 1);
    for (int i = 0; i < n - 1; i++)
        for (int j = 0; j < n - 1; j++) {
            const double a = distances[n - 1][i], b = distances[n - 1][j], c = distances[i][j];
            cosines(i, j) = (a * a + b * b - c * c) / (2 * a * b);
        }
    return cosines.determinant() < flat;
}

/**
 * Coordinates about the centre of mass that have the given distances. Where handedness matters,
 * they are mirrored to fit the positions.
 */
vector<Vec3> BodyGeometryBuilder::shapeFromDistances(const vector<Vec3>& members) const {
    const int n = massive.size();
    vector<Vec3> x(n);
    const string remedy =
        "; mend the System's constraints, or give the body explicit site positions";
    if (n == 2) x[1] = Vec3(distances[0][1], 0, 0);
    if (n == 3) {
        const double a = distances[0][1], b = distances[0][2], c = distances[1][2];
        const double along = (a * a + b * b - c * c) / (2 * a), across2 = b * b - along * along;
        if (across2 < -1e-12 * b * b)
            throw OpenMMException("CustomRigidHIIntegrator: " + name + ": constraint lengths " +
                                  to_string(a) + ", " + to_string(b) + ", " + to_string(c) +
                                  " nm violate the triangle inequality" + remedy);
        x[1] = Vec3(a, 0, 0);
        x[2] = Vec3(along, sqrt(max(0.0, across2)), 0);
    }
    if (n <= 3) return x;

    // Classical scaling: the coordinates are a factor of the Gram matrix about the centroid.
    Eigen::MatrixXd squared(n, n);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) squared(i, j) = distances[i][j] * distances[i][j];
    const Eigen::MatrixXd centring =
        Eigen::MatrixXd::Identity(n, n) - Eigen::MatrixXd::Constant(n, n, 1.0 / n);
    const Eigen::MatrixXd gram = -0.5 * centring * squared * centring;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(gram);
    const double largest = eigen.eigenvalues()[n - 1];
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            const double value = eigen.eigenvalues()[n - 1 - k];
            // A smaller value is rounding; its square root would turn 1e-16 into a coordinate of
            // 1e-8.
            x[i][k] =
                value > 1e-12 * largest ? sqrt(value) * eigen.eigenvectors()(i, n - 1 - k) : 0;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            const Vec3 d = x[i] - x[j];
            if (abs(sqrt(d.dot(d)) - distances[i][j]) > constraintTolerance * distances[i][j])
                throw OpenMMException(
                    "CustomRigidHIIntegrator: " + name + ": the constraints between particles " +
                    to_string(particles[massive[i]]) + " and " + to_string(particles[massive[j]]) +
                    " and the others cannot be satisfied in three dimensions" + remedy);
        }
    double handedness = 0;  // of the positions relative to the coordinates: sign of det sum x y^T
    Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
    Vec3 centre;
    for (int i = 0; i < n; i++) centre += members[massive[i]] / n;
    for (int i = 0; i < n; i++)
        correlation += toEigen(members[massive[i]] - centre) * toEigen(x[i]).transpose();
    handedness = correlation.determinant();
    if (handedness < 0)
        for (Vec3& v : x) v[2] = -v[2];
    return x;
}

bool BodyGeometryBuilder::agrees(const BodyGeometry& known) const {
    if (massless ? known.mass != 0 : known.mass == 0) return false;
    vector<double> all(particles.size(), 0.0);
    for (size_t i = 0; i < massive.size() && !massless; i++) all[massive[i]] = masses[i];
    if (!massless && !massesMake(known, all)) return false;
    for (size_t i = 0; i < massive.size() && fixedByConstraints && !massless; i++)
        for (size_t j = 0; j < i; j++) {
            const Vec3 d = known.sites[massive[i]] - known.sites[massive[j]];
            if (abs(sqrt(d.dot(d)) - distances[i][j]) > constraintTolerance * distances[i][j])
                return false;
        }
    map<int, Vec3> siteOfParticle;
    double size = 0;
    for (size_t i = 0; i < particles.size(); i++) {
        siteOfParticle[particles[i]] = known.sites[i];
        size = max(size, sqrt(known.sites[i].dot(known.sites[i])));
    }
    for (size_t i = 0; i < particles.size(); i++) {
        if (!system.isVirtualSite(particles[i])) continue;
        const Vec3 off = known.sites[i] -
                         virtualSitePosition(system, particles[i],
                                             [&](int parent) { return siteOfParticle.at(parent); });
        if (!(sqrt(off.dot(off)) <= virtualSiteTolerance * size)) return false;
    }
    return true;
}

BodyGeometry BodyGeometryBuilder::update(const BodyGeometry& known) const {
    if (!needsPositions()) return build({});
    return agrees(known) ? known : build(known.sites);
}

BodyGeometry BodyGeometryBuilder::build(const vector<Vec3>& members) const {
    vector<Vec3> actual(massive.size());
    if (needsPositions())
        for (size_t i = 0; i < massive.size(); i++) actual[i] = members[massive[i]];
    const vector<Vec3> shape =
        fixedByConstraints && massive.size() > 1 ? shapeFromDistances(members) : actual;
    const PrincipalFrame frame(masses, shape);

    BodyGeometry geometry;
    if (!massless) {
        geometry.mass = frame.mass;
        geometry.moments = frame.moments;
    }
    geometry.sites.resize(particles.size());
    map<int, Vec3> siteOfParticle;
    for (size_t i = 0; i < massive.size(); i++)
        siteOfParticle[particles[massive[i]]] = geometry.sites[massive[i]] = frame.toBody(shape[i]);
    if (hasOtherMassless) {
        // Place the other members by the rotation that takes the massive members from their
        // positions into the body frame.
        Vec3 centre;
        for (size_t i = 0; i < massive.size(); i++) centre += actual[i] * (masses[i] / frame.mass);
        Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
        for (size_t i = 0; i < massive.size(); i++)
            correlation += masses[i] * toEigen(geometry.sites[massive[i]]) *
                           toEigen(actual[i] - centre).transpose();
        Eigen::JacobiSVD<Eigen::Matrix3d> svd(correlation,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
        Eigen::Matrix3d fix = Eigen::Matrix3d::Identity();
        fix(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
        const Eigen::Matrix3d toBody = svd.matrixU() * fix * svd.matrixV().transpose();
        for (size_t i = 0; i < particles.size(); i++)
            if (system.getParticleMass(particles[i]) == 0 && !system.isVirtualSite(particles[i]))
                siteOfParticle[particles[i]] = geometry.sites[i] =
                    toVec3(toBody * toEigen(members[i] - centre));
    }
    for (size_t i = 0; i < particles.size(); i++)
        if (system.isVirtualSite(particles[i]))
            geometry.sites[i] = virtualSitePosition(
                system, particles[i], [&](int parent) { return siteOfParticle.at(parent); });
    return geometry;
}

}  // namespace RigidHIPlugin
