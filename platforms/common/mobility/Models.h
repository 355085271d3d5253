#ifndef RIGIDHI_MODELS_H_
#define RIGIDHI_MODELS_H_

#include <memory>

#include "mobility/MobilityOperator.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * The operator of a MobilityForce's model and boundary, the readable one of one thread. A new model is entered here.
 *
 * @param crossingAllowed  whether surfaces of particles may reach through a wall
 */
std::unique_ptr<MobilityOperator> createScalarMobility(const MobilityForce& force, bool crossingAllowed,
                                                       const HydrodynamicParticles& particles);
/** The names of a model and of a boundary, for describeEffects() and messages. */
const char* modelName(MobilityForce::Model model);
const char* boundaryName(MobilityForce::Boundary boundary);
/** Whether a model has a boundary. A new boundary is entered here. */
bool hasBoundary(MobilityForce::Model model, MobilityForce::Boundary boundary);

}  // namespace RigidHIPlugin

#endif
