#ifndef RIGIDHI_SLIP_SPACE_H_
#define RIGIDHI_SLIP_SPACE_H_

#include <Eigen/Core>
#include <vector>

#include "rigid/CoupledBodies.h"

namespace RigidHIPlugin {

/**
 * Whether slips (random velocities) belong to hydrodynamic particles or to bodies. Slips of
 * particles have three rows each, six for a sphere. Slips belong to bodies where there is no M
 * (CoupledBodies::slipsAreOfBodies()). For bodies, and for spheres about their centres, K = 1.
 */
class SlipSpace {
public:
    explicit SlipSpace(const CoupledBodies& bodies);
    int getNumRows() const { return ofBodies ? bodies.getNumRows() : bodies.getNumParticleRows(); }
    bool areOfBodies() const { return ofBodies; }
    /** Whether K = 1. */
    bool isIdentity() const { return identity; }
    /** Whether slips move bodies as they are, U = N F + s: K = 1 and nothing is fixed. */
    bool slipsAreTwists() const { return identity && !bodies.getFreeMotion().any(); }

    /** slips = K U, wrenches = K^T lambda at any poses. */
    void rigidSlips(const std::vector<Pose>& poses, const Eigen::MatrixXd& twists,
                    Eigen::MatrixXd& slips);
    void totalWrenches(const std::vector<Pose>& poses, const Eigen::MatrixXd& lambda,
                       Eigen::MatrixXd& wrenches);
    /**
     * The twists (K^T K)^-1 K^T s nearest to slips (Westwood 2022, eq. 38). @param turns  rotations
     * of the bodies
     */
    void nearestTwists(const std::vector<Eigen::Matrix3d>& turns, const Eigen::MatrixXd& slips,
                       Eigen::MatrixXd& twists) const;
    /** The matrix (K^T K)^-1 K^T of an element in its frame; empty where K = 1. */
    const Eigen::MatrixXd& nearestOfElement_body(int element) const {
        return nearest_body[element];
    }

private:
    void nearestTwistsOfParticles(const std::vector<Eigen::Matrix3d>& turns,
                                  const Eigen::MatrixXd& slips, Eigen::MatrixXd& twists) const;

    const CoupledBodies& bodies;
    const bool ofBodies, identity;
    std::vector<Eigen::MatrixXd> nearest_body;  // (K^T K)^-1 K^T of elements, body frame
    std::vector<Eigen::Matrix3d> turns;         // of poses that are asked about
};

}  // namespace RigidHIPlugin

#endif
