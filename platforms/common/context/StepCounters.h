#ifndef RIGIDHI_STEP_COUNTERS_H_
#define RIGIDHI_STEP_COUNTERS_H_

#include <chrono>

#include "host/StepSettings.h"

namespace RigidHIPlugin {

/**
 * Counters of steps so far. They are plain numbers, since a step must not allocate.
 * getStepStatistics() gives them names.
 */
struct StepCounters {
    long long steps = 0, forceEvaluations = 0, rejectedSteps = 0;
    long long randomNumbers = 0, squareRoots = 0, iterations = 0;
    double seconds_forces = 0, seconds_mobility = 0, seconds_scheme = 0;

    void add(const LoopResult& result) {
        randomNumbers += result.randomNumbers;
        squareRoots += result.squareRoots;
        iterations += result.iterations;
    }
    /** Seconds since an arbitrary point in time. */
    static double now() {
        return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
            .count();
    }
};

}  // namespace RigidHIPlugin

#endif
