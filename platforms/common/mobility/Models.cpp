#include "mobility/Models.h"

#include "mobility/RotnePragerYamakawa.h"
#include "mobility/RotnePragerYamakawaWall.h"
#include "mobility/SphereWall.h"
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
            return withSphereWallMobility(force, particles,
                                          unique_ptr<MobilityOperator>(new RotnePragerYamakawaWall(
                                              particles, force.getViscosity(), planeOf(force, crossingAllowed))));
        case MobilityForce::Unbounded: break;
    }
    return unique_ptr<MobilityOperator>(new RotnePragerYamakawa(particles, force.getViscosity()));
}

NoSlipPlane planeOf(const MobilityForce& force, bool crossingAllowed) {
    return NoSlipPlane(force.getWallHeight(), crossingAllowed);
}

unique_ptr<MobilityOperator> withSphereWallMobility(const MobilityForce& force, const HydrodynamicParticles& particles,
                                                    unique_ptr<MobilityOperator> model) {
    if (force.getSphereWallMobility() == MobilityForce::FromModel) return model;
    return unique_ptr<MobilityOperator>(
        new SphereWallCongruence(particles, force.getViscosity(), planeOf(force, false), move(model)));
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
