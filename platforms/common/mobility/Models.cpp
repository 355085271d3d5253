#include "mobility/Models.h"

#include <openmm/OpenMMException.h>

#include <string>

#include "mobility/RotnePragerYamakawa.h"
#include "mobility/RotnePragerYamakawaWall.h"
#include "mobility/SphereWall.h"
#include "mobility/StokesianDynamics.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

[[noreturn]] void refuse(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    const auto text = [](const char* name, int value) { return *name ? string(name) : to_string(value); };
    throw OpenMM::OpenMMException("MobilityForce: nothing computes model " + text(modelName(model), model) +
                                  " with boundary " + text(boundaryName(boundary), boundary) +
                                  "; choose a model and a boundary that it has by setModel() and setBoundary()");
}

/** A model above the wall, with what setSphereWallMobility() asks for. */
unique_ptr<MobilityModel> withSphereWallMobility(const MobilityForce& force, const HydrodynamicParticles& particles,
                                                 unique_ptr<MobilityModel> model) {
    switch (force.getSphereWallMobility()) {
        case MobilityForce::FromModel: return model;
        case MobilityForce::BestKnown:
            return unique_ptr<MobilityModel>(new SphereWallCongruence(
                particles, force.getViscosity(), NoSlipPlane(force.getWallHeight(), false), move(model)));
    }
    refuse(force.getModel(), force.getBoundary());
}

unique_ptr<MobilityModel> rotnePragerYamakawa(const MobilityForce& force, bool crossingAllowed,
                                              const HydrodynamicParticles& particles, const PlatformModels& own) {
    const double eta = force.getViscosity();
    switch (force.getBoundary()) {
        case MobilityForce::Unbounded:
            if (own.rotnePragerYamakawa) return own.rotnePragerYamakawa(particles, eta, {});
            return unique_ptr<MobilityModel>(new RotnePragerYamakawa(particles, eta));
        case MobilityForce::NoSlipWall: {
            const NoSlipPlane wall(force.getWallHeight(), crossingAllowed);
            return withSphereWallMobility(
                force, particles,
                own.rotnePragerYamakawa ? own.rotnePragerYamakawa(particles, eta, wall)
                                        : unique_ptr<MobilityModel>(new RotnePragerYamakawaWall(particles, eta, wall)));
        }
    }
    refuse(force.getModel(), force.getBoundary());
}

}  // namespace

// No default in these switches: the compiler then names those that do not know a new model or boundary.
unique_ptr<MobilityModel> createMobility(const MobilityForce& force, bool crossingAllowed,
                                         const HydrodynamicParticles& particles, const PlatformModels& own) {
    checkOperator(force.getModel(), force.getBoundary());
    switch (force.getModel()) {
        case MobilityForce::StokesianDynamics:
            return unique_ptr<MobilityModel>(
                new StokesianDynamics(particles, force.getViscosity(), force.getLubrication(), force.getMinimumGap()));
        // What does not feel others still feels itself: the blobs of one body make its tensor.
        case MobilityForce::FreeDraining:
        case MobilityForce::RotnePragerYamakawa: return rotnePragerYamakawa(force, crossingAllowed, particles, own);
    }
    refuse(force.getModel(), force.getBoundary());
}

void checkOperator(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    if (!hasBoundary(model, boundary)) refuse(model, boundary);
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
        case MobilityForce::Unbounded: return *modelName(model) != 0;
        case MobilityForce::NoSlipWall: return model == MobilityForce::RotnePragerYamakawa;
    }
    return false;
}

}  // namespace RigidHIPlugin
