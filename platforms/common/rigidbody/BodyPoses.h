#ifndef RIGIDHI_BODY_POSES_H_
#define RIGIDHI_BODY_POSES_H_

#include "rigidbody/BodySet.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/** The pose of a body, in the inner frame of BodySet. */
inline Pose poseOf(const BodySet& bodies, int body) {
    const int s = bodies.slot(body);
    Pose pose;
    pose.R = Eigen::Vector3d(bodies.R[0][s], bodies.R[1][s], bodies.R[2][s]);
    pose.q = {bodies.q[0][s], bodies.q[1][s], bodies.q[2][s], bodies.q[3][s]};
    return pose;
}

}  // namespace RigidHIPlugin

#endif
