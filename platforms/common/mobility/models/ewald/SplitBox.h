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
    /** @param before  another box, whose tables are shared if they are the same; may be null */
    SplitBox(const std::vector<EwaldKind>& kinds, const EwaldSplitting& splitting,
             const BoxVectors& box, const SplitBox* before = nullptr);
    const BoxVectors box;
    const EwaldSplitting splitting;
    /** The largest spacing of nodes, nm. */
    const double spacing;

private:
    const std::shared_ptr<const NearTables> shared;

public:
    const NearTables& tables;
    const GridResolution resolution;
    /**
     * The factors of channels. For each kind of particles: those of forces, followed by those of
     * torques or dipoles if the kind has any.
     */
    std::vector<std::unique_ptr<const GridFactors>> factors;
};

}  // namespace RigidHIPlugin

#endif
