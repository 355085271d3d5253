#ifndef RIGIDHI_VIRIAL_H_
#define RIGIDHI_VIRIAL_H_

#include <openmm/internal/ContextImpl.h>

#include <Eigen/Core>

#include "context/Scene.h"

namespace RigidHIPlugin {

/**
 * Sum of F_a X_b over bodies and over particles in no body, with X the origin of a body, and with
 * nearest images, for a <= b: minus the derivative of OpenMM's energy by a strain of box and
 * origins, x_a += strain x_b, in which bodies neither turn nor change shape. The derivative is a
 * central difference. Arrays must allow for setBox(), and are as before afterwards.
 */
Eigen::Matrix3d virialOf(OpenMM::ContextImpl& context, Scene& scene);

}  // namespace RigidHIPlugin

#endif
