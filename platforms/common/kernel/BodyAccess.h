#ifndef RIGIDHI_BODY_ACCESS_H_
#define RIGIDHI_BODY_ACCESS_H_

#include <memory>
#include <string>

#include "openmmrigidhi/internal/BodiesInContext.h"

namespace RigidHIPlugin {

class ContextMirror;
class Scene;
class Stepper;

/**
 * The answers to users about the bodies of a scene on the platform of this name.
 *
 * The class has no declaration of its own: BodiesInContext declares its methods.
 */
std::unique_ptr<BodiesInContext> accessToBodies(Scene& scene, ContextMirror& mirror,
                                                Stepper& stepper, const std::string& platform);

}  // namespace RigidHIPlugin

#endif
