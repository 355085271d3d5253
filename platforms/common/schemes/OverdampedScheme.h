#ifndef RIGIDHI_OVERDAMPED_SCHEME_H_
#define RIGIDHI_OVERDAMPED_SCHEME_H_

#include <vector>

#include "schemes/OverdampedMove.h"

namespace RigidHIPlugin {

/**
 * A scheme without momenta, on its way through the steps of one group of bodies. Each scheme is a
 * class in a file of its own, in schemes/overdamped. The class owns the vectors that it keeps
 * within and between its stages, so that a step allocates nothing.
 *
 * A stage goes from the poses where the forces of the stage were evaluated to the poses where the
 * next stage wants forces, or to the end. Besides run() a scheme has static constexpr
 * std::array<double, stages> forcesAt. It holds the times at which its stages want forces, as parts
 * of the step: 0 for the start (the first stage only), or `noForces` in the first stage.
 */
class OverdampedScheme {
public:
    using Vectors = OverdampedMove::Vectors;
    static constexpr double noForces = -1;
    /** Whether the noise is that of the start, and the mobility that of a mid-point (SpinBounds).
     */
    static constexpr bool hasMobilityOfMidpoint = false;

    virtual ~OverdampedScheme() {}
    /** @param stage  0 begins a step: `move` is at its start */
    virtual void run(int stage, OverdampedMove& move) = 0;
    /**
     * Vectors of this step that the next step needs, with one row for each row of the twists. They
     * are saved with checkpoints and States, and restored with a step that is redone or fails. They
     * are emptied (size 0) where others changed poses or another scheme moved the bodies. Default:
     * none.
     */
    virtual std::vector<Vectors*> memory() { return {}; }
};

}  // namespace RigidHIPlugin

#endif
