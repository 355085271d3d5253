#ifndef RIGIDHI_SYMMETRISE_H_
#define RIGIDHI_SYMMETRISE_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/** matrix <- (matrix + matrix^T)/2, in place. */
inline void symmetrise(Eigen::MatrixXd& matrix) {
    for (int k = 0; k < matrix.cols(); k++)
        for (int i = 0; i < k; i++)
            matrix(i, k) = matrix(k, i) = 0.5 * (matrix(i, k) + matrix(k, i));
}

}  // namespace RigidHIPlugin

#endif
