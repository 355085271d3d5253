#include "EigenInstances.h"

namespace Eigen {
RIGIDHI_EIGEN_INSTANCES()
namespace internal {
RIGIDHI_EIGEN_PRODUCTS()
}
}  // namespace Eigen
