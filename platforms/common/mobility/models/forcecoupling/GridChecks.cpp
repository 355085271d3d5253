#include "mobility/models/forcecoupling/GridChecks.h"

#include <openmm/OpenMMException.h>

#include <fstream>
#include <limits>

#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

namespace {

/** Up to this size, wave numbers of modes fit into the counters of random numbers. */
const int largestSize = 8190;

/** Free memory of this machine in bytes; infinity if unknown. */
double freeMemory() {
    std::ifstream info("/proc/meminfo");
    std::string word;
    for (double kilobytes; info >> word;)
        if (word == "MemAvailable:" && info >> kilobytes) return 1024 * kilobytes;
    return std::numeric_limits<double>::infinity();
}

}  // namespace

void refuseGrid(const std::string& model, const std::string& problem) {
    throw OpenMM::OpenMMException("MobilityForce: " + model + " on a grid " + problem);
}

void checkBoxOfGrid(const std::string& model, const BoxVectors& box, bool mayLean) {
    const bool leans = box[1][0] != 0 || box[2][0] != 0 || box[2][1] != 0;
    if (leans && !mayLean)
        refuseGrid(
            model,
            "needs a box with edges along the axes, but the periodic box has the vectors " +
                text(box[0]) + ", " + text(box[1]) + ", " + text(box[2]) +
                " nm; use setSolver(Dense), which takes triclinic boxes too, or an orthogonal box");
    if (!(box[0][0] > 0 && box[1][1] > 0 && box[2][2] > 0))
        refuseGrid(model,
                   "needs a periodic box, but the System has none; set a box by "
                   "setDefaultPeriodicBoxVectors() on the System");
}

void checkSizeOfGrid(const std::string& model, const BoxVectors& box, double spacing) {
    for (int axis = 0; axis < 3; axis++)
        if (!(box[axis][axis] / spacing < largestSize))
            refuseGrid(
                model,
                "would need " + text(box[axis][axis] / spacing, 6) + " nodes along an edge of " +
                    text(box[axis][axis]) + " nm, but must have fewer than " +
                    std::to_string(largestSize) +
                    "; raise setSolverTolerance() or setGridSpacing(), or make the box smaller");
}

bool fitsIntoMemory(double bytes, double held) {
    const double more = 1e-9 * (bytes - held);
    // Look up the free memory only for a large additional amount.
    return !(more > 0.5 && more > 1e-9 * freeMemory());
}

void checkMemoryOfGrid(const std::string& model, const GridShape& shape, double bytes, double held,
                       const std::string& also) {
    if (fitsIntoMemory(bytes, held)) return;
    const double gigabytes = 1e-9 * bytes;
    refuseGrid(model, "needs " + text(gigabytes, 3) + " GB of memory for " +
                          std::to_string(shape.size[0]) + " x " + std::to_string(shape.numRows()) +
                          " x " + std::to_string(shape.size[2]) + " nodes" + also + ", but only " +
                          text(1e-9 * freeMemory(), 3) +
                          " GB are free; raise setSolverTolerance() or setGridSpacing(), or make "
                          "the box smaller");
}

void checkMemoryOfPairs(const std::string& model, double neighbours, double gap, double bytes,
                        double held) {
    if (fitsIntoMemory(bytes, held)) return;
    refuseGrid(model,
               "needs " + text(1e-9 * bytes, 3) + " GB of memory, most of it for the " +
                   text(neighbours, 3) + " neighbours of each particle within a gap of " +
                   text(gap, 3) + " nm, but only " + text(1e-9 * freeMemory(), 3) +
                   " GB are free; lower setGridSpacing() or set it to 0 (chosen by the solver "
                   "tolerance), raise setSolverTolerance(), or simulate fewer particles");
}

}  // namespace RigidHIPlugin
