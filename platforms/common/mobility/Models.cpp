#include "mobility/Models.h"

#include "mobility/RotnePragerYamakawa.h"
#include "mobility/StokesianDynamics.h"

using namespace std;

namespace RigidHIPlugin {

unique_ptr<MobilityOperator> createScalarMobility(const MobilityForce& force, const HydrodynamicParticles& particles) {
    switch (force.getModel()) {
        case MobilityForce::StokesianDynamics:
            return unique_ptr<MobilityOperator>(
                new StokesianDynamics(particles, force.getViscosity(), force.getLubrication(), force.getMinimumGap()));
        // What does not feel others still feels itself: the blobs of one body make its tensor.
        case MobilityForce::FreeDraining:
        case MobilityForce::RotnePragerYamakawa: break;
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

}  // namespace RigidHIPlugin
