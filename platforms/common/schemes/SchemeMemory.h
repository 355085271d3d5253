#ifndef RIGIDHI_SCHEME_MEMORY_H_
#define RIGIDHI_SCHEME_MEMORY_H_

#include <Eigen/Core>
#include <string>
#include <vector>

namespace RigidHIPlugin {

/**
 * Data that a scheme without momenta keeps between steps, for each group of bodies
 * (OverdampedScheme::memory()).
 */
struct SchemeMemory {
    std::string scheme;  // the name of the scheme
    std::vector<std::vector<Eigen::MatrixXd>> groups;
};

}  // namespace RigidHIPlugin

#endif
