#ifndef RIGIDHI_GRID_SECONDS_H_
#define RIGIDHI_GRID_SECONDS_H_

#include <algorithm>
#include <chrono>

namespace RigidHIPlugin {

/**
 * Seconds that a fluid on a grid has taken, summed over all threads, for getStepStatistics(). They
 * are 0 without a grid.
 */
struct GridSeconds {
    double spreading = 0;   // forces to nodes
    double transforms = 0;  // Fourier transforms, with the fluid's response to each mode
    double averaging = 0;   // velocities and gradients over nodes

    void add(const GridSeconds& other, double factor = 1) {
        spreading += factor * other.spreading;
        transforms += factor * other.transforms;
        averaging += factor * other.averaging;
    }
    /** Set each number to the larger of its own and the other's. */
    void raise(const GridSeconds& other) {
        spreading = std::max(spreading, other.spreading);
        transforms = std::max(transforms, other.transforms);
        averaging = std::max(averaging, other.averaging);
    }
};

/** Adds the seconds from its construction to its destruction. */
class ScopedTimer {
public:
    explicit ScopedTimer(double& seconds) : seconds(seconds) {}
    ~ScopedTimer() {
        seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }
    ScopedTimer(const ScopedTimer&) = delete;

private:
    double& seconds;
    const std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
};

}  // namespace RigidHIPlugin

#endif
