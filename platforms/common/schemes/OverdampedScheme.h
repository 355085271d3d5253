#ifndef RIGIDHI_OVERDAMPED_SCHEME_H_
#define RIGIDHI_OVERDAMPED_SCHEME_H_

#include <vector>

#include "schemes/OverdampedMove.h"

namespace RigidHIPlugin {

/**
 * A scheme without momenta, for the steps of one group of bodies. Each scheme is a class in a file
 * of its own, in schemes/overdamped. The class owns the vectors that it uses within and between its
 * stages, so that a step allocates nothing.
 *
 * A stage goes from the poses where its forces were evaluated to the poses where the next stage
 * needs forces, or to the end. Besides run() a scheme has a static constexpr std::array<double,
 * stages> forcesAt, with the times at which its stages need forces, as fractions of the step. The
 * first stage has 0 for the start, or `noForces`.
 */
class OverdampedScheme {
public:
    using Vectors = OverdampedMove::Vectors;
    static constexpr double noForces = -1;
    /**
     * Whether the step takes its noise at the start, and its mobility at a mid-point (SpinBounds).
     */
    static constexpr bool hasMobilityOfMidpoint = false;

    virtual ~OverdampedScheme() {}
    /** @param stage  0 begins a step; `move` is then at the start */
    virtual void run(int stage, OverdampedMove& move) = 0;
    /**
     * Vectors of this step that the next step needs, with one row for each row of the twists.
     * Checkpoints and States save them, and redoing or giving up a step restores them. They become
     * empty (size 0) when others have changed poses or another scheme has moved the bodies.
     * Default: none.
     */
    virtual std::vector<Vectors*> memory() { return {}; }
};

}  // namespace RigidHIPlugin

#endif
