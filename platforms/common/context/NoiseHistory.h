#ifndef RIGIDHI_NOISE_HISTORY_H_
#define RIGIDHI_NOISE_HISTORY_H_

#include <cstdint>
#include <deque>
#include <optional>

#include "context/SavedState.h"

namespace RigidHIPlugin {

class Scene;

/**
 * Which random numbers the trajectories of a Context have used.
 *
 * A seed and the number of a step determine the random numbers of this step. Both are part of a
 * State, so that a run goes on from it with the numbers of the uninterrupted run. Langevin
 * trajectories with the same numbers come together, and a State may be where several begin. So the
 * first step after loading gives the trajectory a seed of its own
 * - if the positions or velocities are not those of the State, as velocities that are drawn anew;
 * - if the temperature, frictions, the step size, the scheme or the Context's parameters are not
 *   those with which the State was saved, as far as it was saved in this Context;
 * - if another trajectory of this Context has used the numbers, as in replica exchange.
 * The same holds for a step after positions or velocities were set, if another trajectory of the
 * Context has used its numbers. The seed follows from the State, the changes and these settings.
 * The same State, loaded once more and unchanged, repeats its trajectory bit for bit.
 */
class NoiseHistory {
public:
    /** Begin with a seed that the integrator or the user has set. */
    void setSeed(uint32_t seed, const Scene& scene);
    /** Others have set positions or velocities, from which another trajectory goes on. */
    void stateWasSet(const Scene& scene);
    /**
     * The seed to save. A loaded state that was changed has its own, which its first step would
     * take.
     */
    uint32_t seedToSave(const Scene& scene) const;
    /** Remember the trajectory that has come to this state. */
    void wasSaved(const SavedState& saved, const Scene& scene);
    /** The Context will go on from this state; its random numbers are still those of before. */
    void willLoad(const SavedState& saved, const Scene& scene);
    /** Whether the Context's positions and velocities are those of the loaded state. */
    void loadedWasCompared(bool agrees);
    /**
     * Call this before a step, when all changes by others are taken in.
     *
     * @return a seed of its own for this trajectory, if it must not use the present one
     */
    std::optional<uint32_t> seedForStep(const Scene& scene);

private:
    /** What decides how a trajectory goes on, apart from random numbers. */
    struct Start {
        uint64_t numbers = 0, settings = 0;
        bool operator==(const Start& other) const {
            return numbers == other.numbers && settings == other.settings;
        }
    };
    /** Steps from `begin` to before `end` of one trajectory, whose stretches have the same id. */
    struct Stretch {
        int id = 0;
        uint32_t seed = 0;
        int64_t begin = 0, end = 0;
        Start start;
        bool hasUsersSeed = false;  // which no other may replace
    };
    /** Hashes of a state: of the arrays of particles, and of the bodies. */
    struct Numbers {
        uint64_t positions = 0, velocities = 0, bodies = 0;
        bool operator==(const Numbers& other) const {
            return positions == other.positions && velocities == other.velocities &&
                   bodies == other.bodies;
        }
        uint64_t hash() const;
    };
    static Numbers numbersOf(const SavedState& saved);
    static Numbers numbersOf(const Scene& scene);
    /** Where a state was saved. */
    struct Point {
        uint32_t seed;
        int64_t step;
        Numbers numbers;
        uint64_t settings;
        int stretch;
    };
    /** A loaded state before the first step from it. */
    struct Loading {
        uint32_t seed = 0;
        int64_t step = 0;
        Numbers numbers;
        bool wasCompared = false, disagrees = false, wasSet = false;
        bool mayBeChanged() const { return disagrees || wasSet; }
        bool isChanged(const Scene& scene, const Numbers& now) const;
    };
    /** The beginning of the stretch that a step would begin after loading. */
    struct Beginning {
        Start start;
        uint32_t seed = 0;
        int id = 0;  // of the trajectory that goes on or is repeated; 0: a new one
    };
    Beginning beginAfter(const Loading& from, const Scene& scene) const;
    /** The point where a loaded state was saved; with these settings, if there are several. */
    const Point* findPoint(const Loading& from, uint64_t settings) const;
    void endStretch(const Scene& scene);
    void beginStretch(uint32_t seed, const Scene& scene);

    std::deque<Stretch> stretches;  // that have ended
    std::deque<Point> points;
    std::optional<Loading> loading;
    Stretch present;
    int nextId = 1;
    bool isNew = true;  // before the first step with a seed, positions or velocities that were set
};

}  // namespace RigidHIPlugin

#endif
