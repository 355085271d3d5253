#ifndef RIGIDHI_VIRIAL_H_
#define RIGIDHI_VIRIAL_H_

#include <openmm/internal/ContextImpl.h>

#include <Eigen/Core>

#include "context/Scene.h"

namespace RigidHIPlugin {

/**
 * The sum of F_a X_b over bodies and over particles in no body, for a <= b, where X is the origin
 * of a body or the particle, and nearest images interact. It is minus the derivative of OpenMM's
 * energy with respect to a strain of box and origins, x_a += strain x_b, in which bodies neither
 * turn nor change shape. The derivative is a central difference. Arrays must allow setBox();
 * afterwards they are as before.
 */
Eigen::Matrix3d virialOf(OpenMM::ContextImpl& context, Scene& scene);

}  // namespace RigidHIPlugin

#endif
