#include "mobility/MobilityModel.h"

#include <openmm/OpenMMException.h>

#include <cmath>

#include "linearalgebra/Decompositions.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "rigidbody/EigenVec3.h"

namespace RigidHIPlugin {

Eigen::VectorXd rootsOfOwnFriction(const HydrodynamicParticles& particles, bool stresslets) {
    Eigen::VectorXd roots(particles.numRows + (stresslets ? 5 * particles.size() : 0));
    for (int i = 0; i < particles.size(); i++) {
        const double a = particles.radii[i];
        roots.segment<3>(particles.firstRow[i]).setConstant(std::sqrt(a));
        if (particles.hasTorque[i])
            roots.segment<3>(particles.firstRow[i] + 3)
                .setConstant(std::sqrt(4.0 / 3.0 * a * a * a));
        // The force dipole of a strain rate is 20/3 pi viscosity a^3 times the rate.
        if (stresslets)
            roots.segment<5>(particles.numRows + 5 * i)
                .setConstant(std::sqrt(10.0 / 9.0 * a * a * a));
    }
    return roots;
}

void refuseIndefiniteMobility(int numParticles) {
    throw OpenMM::OpenMMException(
        "MobilityForce: the mobility matrix of " + std::to_string(numParticles) +
        " hydrodynamic particles is not positive definite; look for particles at the same place");
}

void refuseIndefiniteFriction(int numBodies) {
    throw OpenMM::OpenMMException(
        "MobilityForce: the friction matrix of " + std::to_string(numBodies) +
        " bodies is not positive definite; look for a body whose blobs are all at one place");
}

void MobilityModel::follow(const DrivenFlow& flow, const Placement& placement,
                           Eigen::MatrixXd& slips) const {
    slips.resize(particles.numRows, 1);
    for (int i = 0; i < particles.size(); i++) {
        const WaveFactors factors = waveFactors(particles.radii[i], flow.k);
        const int row = particles.firstRow[i];
        const double weight = flow.hasPlanes ? weightInFormulas(i, placement.positions[i]) : 1;
        const Eigen::Vector3d x = toEigen(weight < 1 ? placeInFormulas(i, placement.positions[i])
                                                     : placement.positions[i]);
        slips.block<3, 1>(row, 0) = flow.velocityAt(x, factors);
        if (particles.hasTorque[i])
            slips.block<3, 1>(row + 3, 0) = flow.angularVelocityAt(x, factors);
        if (weight < 1) {
            // The formulas damp the flow of the particle's forces by this weight. Damping the
            // driven flow alike preserves the symmetry.
            const Eigen::Vector3d ofPlane = flow.velocityOfNearerPlane(x[2]);
            slips.block<3, 1>(row, 0) = ofPlane + weight * (slips.block<3, 1>(row, 0) - ofPlane);
            if (particles.hasTorque[i]) slips.block<3, 1>(row + 3, 0) *= weight;
        }
    }
}

MobilityAt::MobilityAt(const MobilityModel& model)
    : particles(model.getParticles()), viscosity(model.getViscosity()) {}

void MobilityAt::addFlowAt(const FlowSources&, const std::vector<OpenMM::Vec3>&, double,
                           Velocities&) {
    throw OpenMM::OpenMMException(
        "MobilityForce: the model does not know the flow at points of the fluid; ask for the "
        "velocities of bodies by applyMobilityInContext()");
}

void MobilityAt::dense(Eigen::MatrixXd& mobility) {
    multiply(Eigen::MatrixXd::Identity(particles.numRows, particles.numRows), mobility);
}

void MobilityAt::friction(Eigen::MatrixXd& friction) {
    Eigen::MatrixXd mobility;
    dense(mobility);
    const Eigen::LLT<Eigen::MatrixXd> factor(mobility);
    if (factor.info() != Eigen::Success) refuseIndefiniteMobility(particles.size());
    friction = factor.solve(Eigen::MatrixXd::Identity(particles.numRows, particles.numRows));
    friction = (0.5 * (friction + friction.transpose())).eval();
}

std::unique_ptr<MobilityAt> MobilityModel::at(const Placement& placement) const {
    std::unique_ptr<MobilityAt> made;
    place(made, placement);
    return made;
}

std::unique_ptr<MobilityAt> MobilityModel::near(const Placement& placement) const {
    std::unique_ptr<MobilityAt> made;
    placeNear(made, placement);
    return made;
}

namespace {

void checkObjection(const MobilityModel& model, const Placement& placement) {
    if (!model.getTraits().mayObject) return;
    const std::string problem = model.objection(placement);
    if (!problem.empty()) throw OpenMM::OpenMMException("MobilityForce: " + problem);
}

}  // namespace

void MobilityModel::place(std::unique_ptr<MobilityAt>& at, const Placement& placement) const {
    checkObjection(*this, placement);
    if (!at) at = makePlace();
    at->moveTo(placement, false);
}

void MobilityModel::placeNear(std::unique_ptr<MobilityAt>& at, const Placement& placement) const {
    if (!traits.holdsNearby) checkObjection(*this, placement);
    if (!at) at = makePlace();
    at->moveTo(placement, traits.holdsNearby || traits.isAnchored);
}

void MobilityModel::ownMobility(const HydrodynamicParticles& body,
                                const std::vector<OpenMM::Vec3>& sites,
                                Eigen::MatrixXd& mobility) const {
    RotnePragerYamakawa(body, viscosity).at({sites})->dense(mobility);
}

}  // namespace RigidHIPlugin
