#ifndef RIGIDHI_REJECTIONS_H_
#define RIGIDHI_REJECTIONS_H_

#include <string>

namespace RigidHIPlugin {

class Scene;

/**
 * Counts rejected steps, which led to poses where the model has no mobility. They are redone with
 * new noise, if new noise can help, up to a limit.
 */
class Rejections {
public:
    explicit Rejections(Scene& scene) : scene(scene) {}
    /**
     * Count rejected steps or groups, after they were put back to the start of the step.
     *
     * @param number     of rejected steps, or of rejected groups of bodies that take the step by
     *     themselves
     * @param attempts   the largest number of rejections in a row of one of them
     * @param objection  the reason for the last rejection of the one with the most attempts
     * @throws OpenMMException after too many rejections in a row, or if new noise cannot help
     */
    void count(int number, int attempts, const std::string& objection);

private:
    Scene& scene;
};

}  // namespace RigidHIPlugin

#endif
