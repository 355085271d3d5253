#ifndef RIGIDHI_COLUMNS_H_
#define RIGIDHI_COLUMNS_H_

#include <Eigen/Core>

#include "rigidbody/Quaternion-inl.h"

namespace RigidHIPlugin {
namespace scalar {

/** Rows `row` ... row + 2 of a column. */
inline Vector3<double> rows(const Eigen::MatrixXd& m, int row, int column) {
    return {m(row, column), m(row + 1, column), m(row + 2, column)};
}
inline void addTo(Eigen::MatrixXd& m, int row, int column, const Vector3<double>& v) {
    m(row, column) += v.x;
    m(row + 1, column) += v.y;
    m(row + 2, column) += v.z;
}

}  // namespace scalar
}  // namespace RigidHIPlugin

#endif
