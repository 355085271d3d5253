#ifndef RIGIDHI_INTEGRATOR_MESSAGES_H_
#define RIGIDHI_INTEGRATOR_MESSAGES_H_

#include <openmm/OpenMMException.h>

#include <string>

#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

/** Throw an error of the integrator. */
[[noreturn]] inline void fail(const std::string& message) {
    throw OpenMM::OpenMMException("CustomRigidHIIntegrator: " + message);
}

}  // namespace RigidHIPlugin

#endif
