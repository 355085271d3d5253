#ifndef RIGIDHI_SPLIT_BOX_H_
#define RIGIDHI_SPLIT_BOX_H_

#include <memory>
#include <vector>

#include "mobility/models/ewald/NearField.h"
#include "mobility/models/forcecoupling/GridChannels.h"

namespace RigidHIPlugin {

/** The data of pairs and waves that depend on the box alone, for all placements in it. */
class SplitBox {
public:
    SplitBox(const std::vector<EwaldKind>& kinds, const EwaldSplitting& splitting,
             const BoxVectors& box);
    const BoxVectors box;
    const EwaldSplitting splitting;
    /** The largest spacing of nodes, nm. */
    const double spacing;
    const NearTables tables;
    const GridResolution resolution;
    /**
     * The factors of channels. For each kind of particles: those of forces and then, if the kind
     * has torques, those of torques.
     */
    std::vector<std::unique_ptr<const GridFactors>> factors;
};

}  // namespace RigidHIPlugin

#endif
