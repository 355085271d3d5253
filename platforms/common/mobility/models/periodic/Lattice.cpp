#include "mobility/models/periodic/Lattice.h"

#include <openmm/OpenMMException.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector3i;

namespace {

void sortByLength(Matrix3d& v) {
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < 2; k++)
            if (v.col(k + 1).squaredNorm() < v.col(k).squaredNorm()) v.col(k).swap(v.col(k + 1));
}

/**
 * Minkowski's reduction: afterwards no vector gets shorter by adding integer multiples of the
 * shorter vectors.
 */
void reduce(Matrix3d& v) {
    const double gain = 1 - 1e-12;  // leaves ties unchanged
    for (bool shorter = true; shorter;) {
        sortByLength(v);
        shorter = false;
        const Vector3d second =
            v.col(1) - std::round(v.col(1).dot(v.col(0)) / v.col(0).squaredNorm()) * v.col(0);
        if (second.squaredNorm() < gain * v.col(1).squaredNorm()) {
            v.col(1) = second;
            shorter = true;
            continue;
        }
        // Remove from the third vector its part in the plane of the other two, and choose the
        // shortest of the neighbouring candidates.
        Eigen::Matrix2d gram;
        gram << v.col(0).squaredNorm(), v.col(0).dot(v.col(1)), v.col(0).dot(v.col(1)),
            v.col(1).squaredNorm();
        const Eigen::Vector2d along = gram.inverse() * (v.leftCols<2>().transpose() * v.col(2));
        Vector3d best = v.col(2);
        for (int x = -1; x <= 1; x++)
            for (int y = -1; y <= 1; y++) {
                const Vector3d trial = v.col(2) - (std::round(along[0]) + x) * v.col(0) -
                                       (std::round(along[1]) + y) * v.col(1);
                if (trial.squaredNorm() < gain * best.squaredNorm()) best = trial;
            }
        shorter = best != v.col(2);
        v.col(2) = best;
    }
}

/**
 * The largest multiple of each vector within a sphere of radius `length`: |n_i| = |v.a_i| <= length
 * |a_i|, with the dual vectors a_i.
 */
Vector3i counts(const Matrix3d& dual, double length) {
    Vector3i n;
    for (int k = 0; k < 3; k++) n[k] = std::floor(length * dual.col(k).norm() * (1 + 1e-12));
    return n;
}

}  // namespace

Lattice::Lattice(const BoxVectors& box) {
    for (int k = 0; k < 3; k++) vectors.col(k) = Vector3d(box[k][0], box[k][1], box[k][2]);
    if (!(std::abs(vectors.determinant()) > 0) || !vectors.allFinite())
        throw OpenMM::OpenMMException(
            "MobilityForce: boundary Periodic needs a periodic box, but its vectors span a volume "
            "of " +
            text(vectors.determinant()) + " nm^3; call setPeriodicBoxVectors() on the Context");
    reduce(vectors);
    volume = std::abs(vectors.determinant());
    inverse = vectors.inverse();
    reciprocal = 2 * M_PI * inverse.transpose();
    for (int x = -1; x <= 1; x += 2)
        for (int y = -1; y <= 1; y += 2)
            reach = std::max(reach, (vectors * Vector3d(0.5, 0.5 * x, 0.5 * y)).norm());
}

Vector3d Lattice::fractions(const OpenMM::Vec3& place) const {
    const Vector3d f = inverse * Vector3d(place[0], place[1], place[2]);
    return f - Vector3d(std::round(f[0]), std::round(f[1]), std::round(f[2]));
}

Vector3d Lattice::wrapped(const OpenMM::Vec3& difference) const {
    const Vector3d r(difference[0], difference[1], difference[2]), f = inverse * r;
    return r - vectors * Vector3d(std::round(f[0]), std::round(f[1]), std::round(f[2]));
}

Vector3d Lattice::nearestImage(const OpenMM::Vec3& difference) const {
    // With reduced vectors, the nearest image is among the neighbours of the wrapped one.
    const Vector3d r = wrapped(difference);
    Vector3d nearest = r;
    for (int x = -1; x <= 1; x++)
        for (int y = -1; y <= 1; y++)
            for (int z = -1; z <= 1; z++) {
                const Vector3d image = r + vectors * Vector3d(x, y, z);
                if (image.squaredNorm() < nearest.squaredNorm()) nearest = image;
            }
    return nearest;
}

std::vector<Vector3d> Lattice::within(double length) const {
    std::vector<Vector3d> found;
    const Vector3i n = counts(inverse.transpose(), length);
    for (int x = -n[0]; x <= n[0]; x++)
        for (int y = -n[1]; y <= n[1]; y++)
            for (int z = -n[2]; z <= n[2]; z++) {
                const Vector3d v = vectors * Vector3d(x, y, z);
                if (v.norm() <= length) found.push_back(v);
            }
    return found;
}

std::vector<Vector3i> Lattice::waves(double length) const {
    std::vector<Vector3i> found;
    const Vector3i n = counts(vectors / (2 * M_PI), length);
    for (int x = 0; x <= n[0]; x++)
        for (int y = x == 0 ? 0 : -n[1]; y <= n[1]; y++)
            for (int z = x == 0 && y == 0 ? 1 : -n[2]; z <= n[2]; z++)
                if ((reciprocal * Vector3d(x, y, z)).norm() <= length) found.emplace_back(x, y, z);
    return found;
}

}  // namespace RigidHIPlugin
