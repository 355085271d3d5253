#ifndef RIGIDHI_POSE_H_
#define RIGIDHI_POSE_H_

#include <Eigen/Core>

#include "rigidbody/Quaternion-inl.h"

namespace RigidHIPlugin {

/** The matrix of a unit quaternion. */
inline Eigen::Matrix3d rotationOf(const scalar::Quaternion<double>& q) {
    const scalar::Rotation<double> turn(q);
    Eigen::Matrix3d A;
    for (int k = 0; k < 3; k++)
        A.row(k) = Eigen::Vector3d(turn.row[k].x, turn.row[k].y, turn.row[k].z);
    return A;
}

/** The position and the orientation of a body. */
struct Pose {
    Eigen::Vector3d R = Eigen::Vector3d::Zero();
    scalar::Quaternion<double> q = {1, 0, 0, 0};  // body frame to lab frame
    Eigen::Matrix3d rotation() const { return rotationOf(q); }
};

/** Whether two poses are the same number for number. */
inline bool areSame(const Pose& a, const Pose& b) {
    return a.R == b.R && a.q.w == b.q.w && a.q.x == b.q.x && a.q.y == b.q.y && a.q.z == b.q.z;
}

}  // namespace RigidHIPlugin

#endif
