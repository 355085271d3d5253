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
 * That changes no force only if all Forces between molecules are periodic. Where a Force is not
 * known to be periodic, nothing is moved. Nothing is moved across the walls of a fluid either: it
 * has no images there, and forces of walls, which depend on the height, may be part of a periodic
 * Force.
 */
class PeriodicImages {
public:
    explicit PeriodicImages(OpenMM::ContextImpl& context);
    /** @return whether any molecule is far; then `images` are positions of the same forces near the
     * box */
    bool find(const std::vector<OpenMM::Vec3>& positions, const OpenMM::Vec3 (&box)[3],
              std::vector<OpenMM::Vec3>& images) const;

private:
    std::vector<std::vector<int>> molecules;  // empty: nothing is to be moved
    int wallAxis = -1;                        // across the walls of the fluid; -1: it has none
};

}  // namespace RigidHIPlugin

#endif
