#include "context/NoiseHistory.h"

#include <string>

#include "context/Scene.h"
#include "context/StateHash.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** As many stretches and points are remembered; samplers load what they saved last. */
const size_t mostRemembered = 4096;

template <class T>
void remember(deque<T>& list, const T& item) {
    list.push_back(item);
    if (list.size() > mostRemembered) list.pop_front();
}

uint64_t mixed(uint64_t hash, uint64_t word) {
    hash = (hash ^ word) * 0x100000001b3u;
    return hash ^ (hash >> 29);
}

/** Velocities as single precision holds them, which no platform rounds any further. */
uint64_t hashOfRounded(const vector<Vec3>& velocities) {
    vector<Vec3> rounded = velocities;
    for (Vec3& v : rounded)
        for (int k = 0; k < 3; k++) v[k] = static_cast<float>(v[k]);
    return hashOf(rounded);
}

}  // namespace

/**
 * Where the platform rounds positions, those that were saved stand for those that were loaded.
 */
NoiseHistory::Start NoiseHistory::startOf(const Scene& scene, uint64_t savedPositions) {
    ContextArrays& arrays = *scene.arrays;
    Start start;
    start.arrays = arrays.rounding().isExact()
                       ? mixed(hashOf(arrays.positions()), hashOf(arrays.velocities()))
                       : mixed(savedPositions, hashOfRounded(arrays.velocities()));
    string settings;
    const auto add = [&](double value) {
        settings.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    add(scene.integrator.getTemperature());
    for (const auto& parameter : scene.contextParameters) {
        settings += parameter.first;
        add(parameter.second);
    }
    start.settings = hashOf(settings);
    return start;
}

const NoiseHistory::Point* NoiseHistory::find(const SavedState& saved) const {
    for (auto point = points.rbegin(); point != points.rend(); ++point)
        if (point->seed == saved.seed && point->step == saved.stepNumber &&
            point->positions == saved.positionsHash && point->velocities == saved.velocitiesHash)
            return &*point;
    return nullptr;
}

void NoiseHistory::endStretch(const Scene& scene) {
    present.end = scene.settings.noise.step;
    if (!wasLoaded && present.end > present.begin) remember(stretches, present);
}

void NoiseHistory::beginStretch(uint32_t seed, const Scene& scene) {
    present = Stretch();
    present.id = nextId++;
    present.seed = seed;
    present.begin = scene.settings.noise.step;
    isNew = true;
}

void NoiseHistory::setSeed(uint32_t seed, const Scene& scene) {
    endStretch(scene);
    beginStretch(seed, scene);
    wasLoaded = false;
}

void NoiseHistory::stateWasSet(const Scene& scene, bool positions) {
    if (wasLoaded) {  // the first step will find the change
        if (positions) loadedPositions = mixed(loadedPositions, ++positionsSet);
        return;
    }
    endStretch(scene);
    beginStretch(present.seed, scene);
}

void NoiseHistory::wasSaved(const SavedState& saved, const Scene& scene) {
    if (!saved.hasBodies) return;
    // A loaded state with other velocities, say, belongs to no trajectory before its first step.
    const int stretch = !wasLoaded ? present.id : loaded ? loaded->stretch : 0;
    remember(points, {saved.seed, saved.stepNumber, saved.positionsHash, saved.velocitiesHash,
                      stretch, startOf(scene, saved.positionsHash)});
}

void NoiseHistory::willLoad(const SavedState& saved, const Scene& scene) {
    endStretch(scene);
    const Point* point = find(saved);
    loaded = point ? optional<Point>(*point) : nullopt;
    loadedPositions = saved.positionsHash;
    wasLoaded = true;
}

optional<uint32_t> NoiseHistory::seedForStep(const Scene& scene) {
    if (!wasLoaded && !isNew) return nullopt;
    const NoiseStream& noise = scene.settings.noise;
    const Start start = startOf(scene, wasLoaded ? loadedPositions : 0);
    if (!wasLoaded) {
        present.start = start;
        isNew = false;
        return nullopt;
    }
    wasLoaded = false;
    // From a point that nobody has changed, the trajectory goes on, or is repeated.
    const bool isUnchanged = loaded && loaded->start == start;
    int id = isUnchanged ? loaded->stretch : 0;
    bool isUsed = false;
    for (const Stretch& other : stretches) {
        if (other.seed != noise.seed || noise.step < other.begin || noise.step >= other.end)
            continue;
        if (noise.step == other.begin && other.start == start)
            id = other.id;  // another repetition
        else if (!isUnchanged || loaded->stretch != other.id)
            // Of a state from elsewhere nothing is known but where it begins.
            isUsed = isUsed || loaded || noise.step == other.begin;
    }
    optional<uint32_t> own;
    if (isUsed) {
        uint64_t hash = mixed(mixed(start.arrays, start.settings), noise.seed);
        hash = mixed(hash, static_cast<uint64_t>(noise.step));
        own = static_cast<uint32_t>(hash ^ (hash >> 32));
        if (*own == 0) own = 1;  // which stands for a fresh seed elsewhere
        id = 0;
    }
    beginStretch(own ? *own : noise.seed, scene);
    if (id) present.id = id;
    present.start = start;
    isNew = false;
    return own;
}

}  // namespace RigidHIPlugin
