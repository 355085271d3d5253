#ifndef RIGIDHI_REJECTIONS_H_
#define RIGIDHI_REJECTIONS_H_

#include <string>

namespace RigidHIPlugin {

class Scene;

/**
 * Steps that led to where the model has no mobility. They are redone with new noise, if that can
 * help, up to a limit.
 */
class Rejections {
public:
    explicit Rejections(Scene& scene) : scene(scene) {}
    /**
     * Count rejected steps or groups, which are at the start of the step again.
     *
     * @param number     of steps, or of groups of bodies that take the step by themselves
     * @param attempts   the largest number in a row of one of them
     * @param objection  the reason to reject the last attempt of the one with most
     * @throws OpenMMException if there were too many in a row, or new noise cannot help
     */
    void count(int number, int attempts, const std::string& objection);

private:
    Scene& scene;
};

}  // namespace RigidHIPlugin

#endif
