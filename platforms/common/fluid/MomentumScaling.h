#ifndef RIGIDHI_MOMENTUM_SCALING_H_
#define RIGIDHI_MOMENTUM_SCALING_H_

#include <Eigen/Core>
#include <vector>

#include "host/FreeParticles.h"
#include "rigid/BodyMobility.h"
#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/**
 * Momenta of a group in the units in which their relaxation is symmetric: Z = K^(1/2) (p, l), with
 * K the inverse masses and moments, and l in the body frame. Each element has three rows for p,
 * then one row for each live axis. Elements whose components are all fixed have no rows.
 *
 * T scales velocities: T V = Z for the momenta of bodies with the velocities V. It has the blocks
 * m^(1/2) and I_k^(1/2) (A e_k)^T.
 */
class MomentumScaling {
public:
    /** @param freeIndex  of each element in FreeParticles; -1 for a body */
    MomentumScaling(const CoupledBodies& coupled, const std::vector<int>& freeIndex,
                    const BodySet& bodies);
    int getNumRows() const { return numRows; }
    /** The first row of an element in Z; -1 if it has no rows. */
    int firstRow(int element) const { return firstRows[element]; }
    int getNumLive(int element) const { return numLive[element]; }
    /**
     * Whether the axes without moments are exactly those about which the fluid does not resist
     * rotation.
     */
    bool deadAxesAreNull() const { return deadAxesAreNull_; }
    const std::vector<int>& getFreeIndex() const { return freeIndex; }

    /**
     * S = T^-T xi T^-1, or its inverse, T N T^T, at the poses of the mobility, where N is the
     * mobility in the presence of fixed components. The inverse needs deadAxesAreNull().
     */
    void matrix(bool inverse, BodyMobility& mobility, const BodySet& bodies,
                const FreeParticles& freeParticles, Eigen::MatrixXd& S);
    /** wrenches = T^T x, and x = T twists, for columns. */
    void wrenches(const Eigen::MatrixXd& x, const BodyMobility& mobility, const BodySet& bodies,
                  const FreeParticles& freeParticles, Eigen::MatrixXd& wrenches) const;
    void scaled(const Eigen::MatrixXd& twists, const BodyMobility& mobility, const BodySet& bodies,
                const FreeParticles& freeParticles, Eigen::MatrixXd& x) const;

private:
    void scale(const Eigen::MatrixXd& from, bool fromZ, const BodyMobility& mobility,
               const BodySet& bodies, const FreeParticles& freeParticles,
               Eigen::MatrixXd& to) const;

    const CoupledBodies& coupled;
    const std::vector<int> freeIndex;
    std::vector<int> firstRows, numLive;  // of each element: rows in Z, live axes of a body
    int numRows = 0;
    bool deadAxesAreNull_ = true;
    Eigen::MatrixXd half;
};

}  // namespace RigidHIPlugin

#endif
