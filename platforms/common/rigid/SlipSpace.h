#ifndef RIGIDHI_SLIP_SPACE_H_
#define RIGIDHI_SLIP_SPACE_H_

#include <Eigen/Core>
#include <vector>

#include "rigid/CoupledBodies.h"

namespace RigidHIPlugin {

/**
 * Whether slips (random velocities) belong to hydrodynamic particles or to bodies. Slips of
 * particles have three rows for a particle, and six for a sphere. Slips belong to bodies where no M
 * exists (CoupledBodies::slipsAreOfBodies()). For slips of bodies, and for spheres about their
 * centres, K = 1.
 *
 * Slips of parts (MobilityTraits::slipsOfParts) are slips of bodies that may have more rows: first
 * the twists, then wrenches on the bodies, then slips of the far part. Slips with the rows of
 * twists alone stand for slips with zeros in the other rows.
 */
class SlipSpace {
public:
    explicit SlipSpace(const CoupledBodies& bodies);
    int getNumRows() const {
        return areOfParts()    ? 2 * bodies.getNumRows() + getNumFarRows()
               : areOfBodies() ? bodies.getNumRows()
                               : bodies.getNumParticleRows();
    }
    bool areOfParts() const { return ofParts; }
    /** Rows of slips of the far part, including the rows of stresslets. */
    int getNumFarRows() const {
        return bodies.getNumParticleRows() + 5 * bodies.getParticles().size();
    }
    /** sum += slips. Both may have the rows of twists alone. */
    void add(const Eigen::MatrixXd& slips, Eigen::MatrixXd& sum) const;
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
     * The twists (K^T K)^-1 K^T s nearest to slips (Westwood 2022, eq. 38).
     *
     * @param turns  rotations of the bodies
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
    void extend(Eigen::MatrixXd& slips) const;
    const bool ofBodies, ofParts, identity;
    std::vector<Eigen::MatrixXd> nearest_body;  // (K^T K)^-1 K^T of elements, body frame
    std::vector<Eigen::Matrix3d> turns;         // of poses that are asked about
};

}  // namespace RigidHIPlugin

#endif
