#ifndef RIGIDHI_MODELS_H_
#define RIGIDHI_MODELS_H_

#include <memory>

#include "mobility/MobilityOperator.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/** The operator of a MobilityForce's model, the readable one of one thread. A new model is entered here. */
std::unique_ptr<MobilityOperator> createScalarMobility(const MobilityForce& force,
                                                       const HydrodynamicParticles& particles);
/** The name of a model, for describeEffects(). */
const char* modelName(MobilityForce::Model model);

}  // namespace RigidHIPlugin

#endif
