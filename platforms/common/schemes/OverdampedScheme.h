#ifndef RIGIDHI_OVERDAMPED_SCHEME_H_
#define RIGIDHI_OVERDAMPED_SCHEME_H_

#include <vector>

#include "schemes/OverdampedMove.h"

namespace RigidHIPlugin {

/**
 * A scheme without momenta, on its way through the steps of one group of bodies. Each is a class in
 * a file of its own, in schemes/overdamped, which owns the vectors that it keeps within and between
 * its stages, so that a step allocates nothing.
 *
 * A stage goes from the poses where the forces of the stage were evaluated to those where the next
 * stage wants them, or to the end. Besides run() a scheme has static constexpr std::array<double,
 * stages> forcesAt, the times at which its stages want forces, as parts of the step: 0 for the
 * start (the first stage only), or `noForces` in the first stage.
 */
class OverdampedScheme {
public:
    typedef OverdampedMove::Vectors Vectors;
    static constexpr double noForces = -1;

    virtual ~OverdampedScheme() {}
    /** @param stage  0 begins a step: `move` is at its start */
    virtual void run(int stage, OverdampedMove& move) = 0;
    /**
     * What the next step needs of this one: vectors with a row for each of those of twists. They
     * are saved with checkpoints and States, put back with a step that is redone or fails, and
     * emptied (size 0) where others changed poses or another scheme moved them. Default: none.
     */
    virtual std::vector<Vectors*> memory() { return {}; }
};

}  // namespace RigidHIPlugin

#endif
