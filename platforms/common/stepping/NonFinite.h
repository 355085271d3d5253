#ifndef RIGIDHI_NON_FINITE_H_
#define RIGIDHI_NON_FINITE_H_

namespace RigidHIPlugin {

class Scene;

/**
 * Report a force, position or velocity of a step that is not finite.
 *
 * @throws OpenMMException always, naming the body or particle
 */
[[noreturn]] void reportNonFinite(Scene& scene, const char* what);

}  // namespace RigidHIPlugin

#endif
