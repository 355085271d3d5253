#ifndef RIGIDHI_PERIODIC_IMAGES_H_
#define RIGIDHI_PERIODIC_IMAGES_H_

#include <openmm/Vec3.h>
#include <openmm/internal/ContextImpl.h>

#include <vector>

namespace RigidHIPlugin {

/**
 * Moves molecules that are far from the box into the box, each as a whole, for a platform that
 * would round their coordinates coarsely.
 *
 * Such a move changes no force only if all Forces between molecules are periodic. If any Force is
 * not known to be periodic, this class moves nothing. It never moves molecules across the walls of
 * a fluid: the fluid has no images there, and a periodic Force may contain forces of walls, which
 * depend on the height.
 */
class PeriodicImages {
public:
    explicit PeriodicImages(OpenMM::ContextImpl& context);
    /**
     * @return whether any molecule is far; then `images` are positions near the box with the same
     *     forces
     */
    bool find(const std::vector<OpenMM::Vec3>& positions, const OpenMM::Vec3 (&box)[3],
              std::vector<OpenMM::Vec3>& images) const;

private:
    std::vector<std::vector<int>> molecules;  // empty: move nothing
    int wallAxis = -1;                        // across the walls of the fluid; -1 without walls
};

/**
 * The first Force that acts differently on periodic images of a molecule, since it acts between
 * molecules or on their places and is not known to be periodic; -1: none.
 */
int forceThatSeesImages(OpenMM::ContextImpl& context);

}  // namespace RigidHIPlugin

#endif
