#ifndef RIGIDHI_POSE_FIT_H_
#define RIGIDHI_POSE_FIT_H_

#include <openmm/Vec3.h>

#include <Eigen/Dense>
#include <array>
#include <vector>

#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {

/**
 * Poses and twists of one body from the positions and velocities of its particles: weighted least
 * squares.
 *
 * Weights are the particles' masses. If these leave open a rotation that all members together would
 * fix (a massless marker beside one massive site), or all masses are zero, every member but virtual
 * sites has weight 1.
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
     * Set R and q of a state to the best fit. Where the positions leave a rotation open (one site,
     * or all on a line), the smallest turn from the state's present orientation is taken.
     *
     * @param positions  where the members are, nm
     * @param state      on entry the last pose, on exit the fitted one
     * @param worst      on exit the member (its place in the body) that is farthest from its place
     * @return that member's distance, nm
     */
    double fitPose(const std::vector<OpenMM::Vec3>& positions, BodyState& state, int& worst) const;
    /**
     * Whether momentum and angular momentum of the members, as point masses, are those of the body:
     * then the twist that fits velocities is simply p = sum m v, l = sum m s x v.
     */
    bool massesMakeTheBody(const BodyGeometry& geometry, const std::vector<double>& masses) const;
    /**
     * The velocity of the origin and the angular velocity (lab) that fit velocities of members best
     * at the pose of a state. Components of the angular velocity on which the velocities say
     * nothing are taken from the argument.
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
    // The principal frame of the weights about their centre. Moments are taken in it: elsewhere the
    // rounding of the large components would swamp the one about a thin axis.
    Eigen::Matrix3d axes;
    Eigen::Vector3d inverseMoments;     // 0 about the line of a line
    std::vector<Eigen::Vector3d> arms;  // sites about the centre, principal frame
};

}  // namespace RigidHIPlugin

#endif
