#ifndef RIGIDHI_POSE_FIT_H_
#define RIGIDHI_POSE_FIT_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <array>
#include <vector>

#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/**
 * Poses and twists of one body from the positions and velocities of its particles, by weighted
 * least squares.
 *
 * Weights are the particles' masses. If these leave a rotation open that all members together would
 * fix (a massless marker beside one massive site), or if all masses are zero, every member except
 * virtual sites has weight 1.
 */
class PoseFit {
public:
    /**
     * @param geometry   the body
     * @param weights    mass of each particle in the System, amu
     * @param isVirtual  which members are virtual sites; they carry no weight
     */
    PoseFit(const BodyGeometry& geometry, const std::vector<double>& weights,
            const std::vector<bool>& isVirtual);
    /**
     * Set R and q of a state to the best fit. If the positions leave a rotation open (one site, or
     * all sites on a line), the fit is the smallest rotation from the state's present orientation.
     *
     * @param positions  positions of the members, nm
     * @param state      on entry the last pose, on exit the fitted one
     * @param worst      on exit the member (its index in the body) that is farthest from its place
     * @return that member's distance, nm
     */
    double fitPose(const std::vector<OpenMM::Vec3>& positions, BodyState& state, int& worst) const;
    /**
     * Whether the members, as point masses, have the momentum and angular momentum of the body. If
     * so, the twist that fits velocities has p = sum m v, l = sum m s x v.
     */
    bool massesMakeTheBody(const BodyGeometry& geometry, const std::vector<double>& masses) const;
    /**
     * The velocity of the origin and the angular velocity (lab) that best fit velocities of members
     * at the pose of a state. Components of the angular velocity that the velocities do not
     * determine keep the values of `omega_lab`.
     */
    void fitTwist(const std::vector<OpenMM::Vec3>& velocities, const BodyState& state,
                  OpenMM::Vec3& velocity, OpenMM::Vec3& omega_lab) const;

private:
    enum class Shape { Point, Line, Spatial };
    std::vector<Eigen::Vector3d> sites;
    std::vector<double> weights;
    double totalWeight = 0;
    Eigen::Vector3d centre_body;
    Shape shape = Shape::Point;
    // The principal frame of the weights about their centre. Moments are computed in this frame: in
    // another frame the rounding of the large components would exceed the moment about a thin axis.
    Eigen::Matrix3d axes;
    Eigen::Vector3d inverseMoments;     // 0 about the line of collinear sites
    std::vector<Eigen::Vector3d> arms;  // sites relative to the centre, principal frame
};

}  // namespace RigidHIPlugin

#endif
