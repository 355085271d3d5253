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
 * State, so that a run goes on from it with the numbers of the uninterrupted run. Where several
 * trajectories take turns in one Context, as in replica exchange, their States would give the same
 * numbers to all of them, and Langevin dynamics with the same noise comes together. If the first
 * step after loading would use numbers that another trajectory has used, this trajectory gets a
 * seed of its own. The seed follows from the State, the temperature and the Context's parameters.
 * The same State alone, loaded once more, repeats its trajectory bit for bit.
 */
class NoiseHistory {
public:
    /** Begin with a seed that the integrator or the user has set. */
    void setSeed(uint32_t seed, const Scene& scene);
    /** Others have set positions or velocities, from which another trajectory goes on. */
    void stateWasSet(const Scene& scene, bool positions);
    /** Remember the trajectory that has come to this state. */
    void wasSaved(const SavedState& saved, const Scene& scene);
    /** The Context will go on from this state; its random numbers are still those of before. */
    void willLoad(const SavedState& saved, const Scene& scene);
    /**
     * Call this before a step, when all changes by others are taken in.
     *
     * @return a seed of its own for this trajectory, if the present one has served another
     */
    std::optional<uint32_t> seedForStep(const Scene& scene);

private:
    /** What decides how a trajectory goes on, apart from random numbers. */
    struct Start {
        uint64_t arrays = 0, settings = 0;
        bool operator==(const Start& other) const {
            return arrays == other.arrays && settings == other.settings;
        }
    };
    /** Steps from `begin` to before `end` of one trajectory, whose stretches have the same id. */
    struct Stretch {
        int id = 0;
        uint32_t seed = 0;
        int64_t begin = 0, end = 0;
        Start start;
    };
    struct Point {
        uint32_t seed;
        int64_t step;
        uint64_t positions, velocities;
        int stretch;
        Start start;
    };
    static Start startOf(const Scene& scene, uint64_t savedPositions);
    const Point* find(const SavedState& saved) const;
    void endStretch(const Scene& scene);
    void beginStretch(uint32_t seed, const Scene& scene);

    std::deque<Stretch> stretches;  // that have ended
    std::deque<Point> points;
    Stretch present;
    int nextId = 1;
    bool isNew = true;  // before the first step with a seed that was set
    bool wasLoaded = false;
    std::optional<Point> loaded;  // the point where the loaded state was saved, if it was here
    uint64_t loadedPositions = 0, positionsSet = 0;
};

}  // namespace RigidHIPlugin

#endif
