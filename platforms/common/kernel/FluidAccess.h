#ifndef RIGIDHI_FLUID_ACCESS_H_
#define RIGIDHI_FLUID_ACCESS_H_

#include <memory>

#include "openmmrigidhi/internal/FluidInContext.h"

namespace RigidHIPlugin {

class ContextMirror;
class Scene;
class Stepper;

/**
 * The answers to users about the fluid of a scene, which may have none.
 *
 * The class has no declaration of its own: FluidInContext declares its methods.
 */
std::unique_ptr<FluidInContext> accessToFluid(Scene& scene, ContextMirror& mirror,
                                              Stepper& stepper);

}  // namespace RigidHIPlugin

#endif
