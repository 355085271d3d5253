#include "mobility/MobilityOperator.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Cholesky>
#include <sstream>

namespace RigidHIPlugin {

void refuseIndefiniteMobility(int numParticles) {
    throw OpenMM::OpenMMException(
        "MobilityForce: the mobility matrix of " + std::to_string(numParticles) +
        " hydrodynamic particles is not positive definite; look for particles at the same place");
}

void refuseIndefiniteFriction(int numBodies) {
    throw OpenMM::OpenMMException("MobilityForce: the friction matrix of " + std::to_string(numBodies) +
                                  " bodies is not positive definite; look for a body whose blobs are all at one place");
}

std::string toleranceText(double tolerance, double wanted) {
    std::ostringstream text;
    text << "the tolerance of " << (wanted > 0 ? wanted : tolerance);
    if (wanted > 0 && wanted != tolerance) text << ", of which an iteration may take " << tolerance << ",";
    return text.str();
}

void MobilityOperator::dense(Eigen::MatrixXd& mobility) const {
    apply(Eigen::MatrixXd::Identity(particles.numRows, particles.numRows), mobility);
}

void MobilityOperator::friction(Eigen::MatrixXd& friction) const {
    Eigen::MatrixXd mobility;
    dense(mobility);
    const Eigen::LLT<Eigen::MatrixXd> factor(mobility);
    if (factor.info() != Eigen::Success) refuseIndefiniteMobility(particles.size());
    friction = factor.solve(Eigen::MatrixXd::Identity(particles.numRows, particles.numRows));
    friction = (0.5 * (friction + friction.transpose())).eval();
}

}  // namespace RigidHIPlugin
