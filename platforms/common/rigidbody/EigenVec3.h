#ifndef RIGIDHI_EIGEN_VEC3_H_
#define RIGIDHI_EIGEN_VEC3_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>

namespace RigidHIPlugin {

inline Eigen::Vector3d toEigen(const OpenMM::Vec3& v) { return Eigen::Vector3d(v[0], v[1], v[2]); }
inline OpenMM::Vec3 toVec3(const Eigen::Vector3d& v) { return OpenMM::Vec3(v[0], v[1], v[2]); }

/** The matrix of the cross product r x. */
inline Eigen::Matrix3d crossMatrix(const Eigen::Vector3d& r) {
    Eigen::Matrix3d m;
    m << 0, -r.z(), r.y(), r.z(), 0, -r.x(), -r.y(), r.x(), 0;
    return m;
}

}  // namespace RigidHIPlugin

#endif
