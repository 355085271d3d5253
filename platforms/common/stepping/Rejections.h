#ifndef RIGIDHI_REJECTIONS_H_
#define RIGIDHI_REJECTIONS_H_

#include <string>

namespace RigidHIPlugin {

class Scene;

/** Steps that led to where the model has no mobility. They are redone with new noise, if that can
 * help, and not for ever. */
class Rejections {
public:
    explicit Rejections(Scene& scene) : scene(scene) {}
    /**
     * Count some; what was rejected is at its start again.
     *
     * @param number     of steps, or of groups of bodies that take it by themselves
     * @param attempts   that were made in a row by the one with most
     * @param objection  to where that one led
     * @throws OpenMMException if there were too many in a row, or new noise cannot help
     */
    void count(int number, int attempts, const std::string& objection);

private:
    Scene& scene;
};

}  // namespace RigidHIPlugin

#endif
