#ifndef RIGIDHI_MODELS_H_
#define RIGIDHI_MODELS_H_

#include <memory>

#include "mobility/NoSlipPlane.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * The operator of a MobilityForce's model and boundary, the readable one of one thread. A new model is entered here.
 *
 * @param crossingAllowed  whether surfaces of particles may reach through a wall
 */
std::unique_ptr<MobilityOperator> createScalarMobility(const MobilityForce& force, bool crossingAllowed,
                                                       const HydrodynamicParticles& particles);
/** The plane of a MobilityForce with the boundary NoSlipWall. */
NoSlipPlane planeOf(const MobilityForce& force, bool crossingAllowed);
/** An operator above that plane, with what setSphereWallMobility() asks for. */
std::unique_ptr<MobilityOperator> withSphereWallMobility(const MobilityForce& force,
                                                         const HydrodynamicParticles& particles,
                                                         std::unique_ptr<MobilityOperator> model);
/** The names of a model and of a boundary, for describeEffects() and messages. */
const char* modelName(MobilityForce::Model model);
const char* boundaryName(MobilityForce::Boundary boundary);
/** Whether a model has a boundary. A new boundary is entered here. */
bool hasBoundary(MobilityForce::Model model, MobilityForce::Boundary boundary);

}  // namespace RigidHIPlugin

#endif
