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
 * known to be periodic, nothing is moved.
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
};

}  // namespace RigidHIPlugin

#endif
