#ifndef RIGIDHI_LATTICE_H_
#define RIGIDHI_LATTICE_H_

#include <Eigen/Core>
#include <vector>

#include "mobility/MobilityAt.h"

namespace RigidHIPlugin {

/**
 * The lattice of a periodic box. Reduction first replaces its vectors by the shortest ones that
 * span the same lattice. So boxes with equivalent vectors give one lattice, and sums over spheres
 * of lattice vectors need as few vectors as possible.
 */
class Lattice {
public:
    Lattice() = default;
    /** @throws OpenMMException if the vectors span no volume, as without a box */
    explicit Lattice(const BoxVectors& box);

    /**
     * The reduced vectors in columns, nm, and the reciprocal vectors: reciprocal^T vectors = 2 pi.
     */
    const Eigen::Matrix3d& getVectors() const { return vectors; }
    const Eigen::Matrix3d& getReciprocal() const { return reciprocal; }
    double getVolume() const { return volume; }
    /**
     * The length of the shortest vector that is not 0, nm: the smallest distance of a particle from
     * its own image.
     */
    double getShortest() const { return vectors.col(0).norm(); }
    /**
     * The coordinates of a position in units of the reduced vectors, each shifted by an integer
     * into [-1/2, 1/2].
     */
    Eigen::Vector3d fractions(const OpenMM::Vec3& place) const;
    /**
     * A difference of positions minus the lattice vector that puts its coordinates into
     * [-1/2, 1/2]. Small differences keep all their digits.
     */
    Eigen::Vector3d wrapped(const OpenMM::Vec3& difference) const;
    /** The shortest vector that differs from this one by a lattice vector. */
    Eigen::Vector3d nearestImage(const OpenMM::Vec3& difference) const;
    /** Lattice vectors of at most this length, including 0. */
    std::vector<Eigen::Vector3d> within(double length) const;
    /**
     * Wave vectors of at most this length, as integer multiples of reciprocal vectors: one of each
     * pair +-k, without 0.
     */
    std::vector<Eigen::Vector3i> waves(double length) const;
    /** The largest length of a vector with coordinates in [-1/2, 1/2]. */
    double getReach() const { return reach; }

private:
    Eigen::Matrix3d vectors = Eigen::Matrix3d::Zero(), inverse = Eigen::Matrix3d::Zero(),
                    reciprocal = Eigen::Matrix3d::Zero();
    double volume = 0, reach = 0;
};

}  // namespace RigidHIPlugin

#endif
