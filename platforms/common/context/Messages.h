#ifndef RIGIDHI_INTEGRATOR_MESSAGES_H_
#define RIGIDHI_INTEGRATOR_MESSAGES_H_

#include "openmmrigidhi/internal/Errors.h"

namespace RigidHIPlugin {

/** Errors of the integrator. */
inline constexpr ErrorsOf fail{"CustomRigidHIIntegrator"};

}  // namespace RigidHIPlugin

#endif
