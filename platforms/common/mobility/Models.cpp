#include "mobility/Models.h"

#include "mobility/RotnePragerYamakawa.h"
#include "mobility/RotnePragerYamakawaWall.h"
#include "mobility/StokesianDynamics.h"

using namespace std;

namespace RigidHIPlugin {

unique_ptr<MobilityOperator> createScalarMobility(const MobilityForce& force, bool crossingAllowed,
                                                  const HydrodynamicParticles& particles) {
    switch (force.getModel()) {
        case MobilityForce::StokesianDynamics:
            return unique_ptr<MobilityOperator>(
                new StokesianDynamics(particles, force.getViscosity(), force.getLubrication(), force.getMinimumGap()));
        // What does not feel others still feels itself: the blobs of one body make its tensor.
        case MobilityForce::FreeDraining:
        case MobilityForce::RotnePragerYamakawa: break;
    }
    switch (force.getBoundary()) {
        case MobilityForce::NoSlipWall:
            return unique_ptr<MobilityOperator>(new RotnePragerYamakawaWall(
                particles, force.getViscosity(), NoSlipPlane(force.getWallHeight(), crossingAllowed)));
        case MobilityForce::Unbounded: break;
    }
    return unique_ptr<MobilityOperator>(new RotnePragerYamakawa(particles, force.getViscosity()));
}

const char* modelName(MobilityForce::Model model) {
    switch (model) {
        case MobilityForce::FreeDraining: return "FreeDraining";
        case MobilityForce::RotnePragerYamakawa: return "RotnePragerYamakawa";
        case MobilityForce::StokesianDynamics: return "StokesianDynamics";
    }
    return "";
}

const char* boundaryName(MobilityForce::Boundary boundary) {
    switch (boundary) {
        case MobilityForce::Unbounded: return "Unbounded";
        case MobilityForce::NoSlipWall: return "NoSlipWall";
    }
    return "";
}

bool hasBoundary(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    switch (boundary) {
        case MobilityForce::Unbounded: return true;
        case MobilityForce::NoSlipWall: return model == MobilityForce::RotnePragerYamakawa;
    }
    return false;
}

}  // namespace RigidHIPlugin
