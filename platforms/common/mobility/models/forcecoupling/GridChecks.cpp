#include "mobility/models/forcecoupling/GridChecks.h"

#include <openmm/OpenMMException.h>

#include <fstream>
#include <limits>

#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

namespace {

/** Wave numbers of modes fit into the counters of random numbers. */
const int largestSize = 8190;

/** Bytes that this machine has free; infinity where it does not say. */
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

void checkBoxOfGrid(const std::string& model, const BoxVectors& box) {
    if (box[1][0] != 0 || box[2][0] != 0 || box[2][1] != 0)
        refuseGrid(
            model,
            "needs a box with edges along the axes, but the periodic box has the vectors " +
                text(box[0]) + ", " + text(box[1]) + ", " + text(box[2]) +
                " nm; use setSolver(Dense), which has triclinic boxes too, or an orthogonal box");
    if (!(box[0][0] > 0 && box[1][1] > 0 && box[2][2] > 0))
        refuseGrid(model,
                   "needs a periodic box, and there is none; set one by "
                   "setDefaultPeriodicBoxVectors() on the System");
}

void checkSizeOfGrid(const std::string& model, const BoxVectors& box, double spacing) {
    for (int axis = 0; axis < 3; axis++)
        if (!(box[axis][axis] / spacing < largestSize))
            refuseGrid(
                model,
                "would have " + text(box[axis][axis] / spacing, 6) + " nodes along an edge of " +
                    text(box[axis][axis]) + " nm, where it may have " +
                    std::to_string(largestSize) +
                    "; raise setSolverTolerance() or setGridSpacing(), or make the box smaller");
}

bool fitsIntoMemory(double bytes, double held) {
    const double more = 1e-9 * (bytes - held);
    // Asked only of what could be too much, and is not there yet.
    return !(more > 0.5 && more > 1e-9 * freeMemory());
}

void checkMemoryOfGrid(const std::string& model, const GridShape& shape, double bytes,
                       double held) {
    if (fitsIntoMemory(bytes, held)) return;
    const double gigabytes = 1e-9 * bytes;
    refuseGrid(model, "would take " + text(gigabytes, 3) + " GB for " +
                          std::to_string(shape.size[0]) + " x " + std::to_string(shape.numRows()) +
                          " x " + std::to_string(shape.size[2]) + " nodes, and " +
                          text(1e-9 * freeMemory(), 3) +
                          " GB are free; raise setSolverTolerance() or setGridSpacing(), or make "
                          "the box smaller");
}

void checkMemoryOfPairs(const std::string& model, double neighbours, double gap, double bytes,
                        double held) {
    if (fitsIntoMemory(bytes, held)) return;
    refuseGrid(model, "would take " + text(1e-9 * bytes, 3) + " GB, most of it for the " +
                          text(neighbours, 3) + " neighbours that a particle has within a gap of " +
                          text(gap, 3) + " nm, and " + text(1e-9 * freeMemory(), 3) +
                          " GB are free; lower setGridSpacing(), or let 0 choose it, raise "
                          "setSolverTolerance(), or simulate fewer particles");
}

}  // namespace RigidHIPlugin
