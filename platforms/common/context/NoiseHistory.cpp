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

/** Numbers as single precision holds them. */
uint64_t hashOfRounded(const vector<Vec3>& array) {
    vector<Vec3> rounded = array;
    for (Vec3& v : rounded)
        for (int k = 0; k < 3; k++) v[k] = static_cast<float>(v[k]);
    return hashOf(rounded);
}

uint64_t hashOfArrays(ContextArrays& arrays) {
    return arrays.rounding().isExact()
               ? mixed(hashOf(arrays.positions()), hashOf(arrays.velocities()))
               : mixed(hashOfRounded(arrays.positions()), hashOfRounded(arrays.velocities()));
}

uint64_t hashOfSettings(const Scene& scene) {
    string settings;
    const auto add = [&](double value) {
        settings.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    add(scene.integrator.getTemperature());
    for (const auto& parameter : scene.contextParameters) {
        settings += parameter.first;
        add(parameter.second);
    }
    return hashOf(settings);
}

}  // namespace

void NoiseHistory::endStretch(const Scene& scene) {
    present.end = scene.settings.noise.step;
    if (!loading && present.end > present.begin) remember(stretches, present);
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
    loading.reset();
}

void NoiseHistory::stateWasSet(const Scene& scene) {
    if (!loading) {
        endStretch(scene);
        beginStretch(present.seed, scene);
    } else if (loading->wasCompared)
        // Before the comparison OpenMM itself sets what it loads.
        loading->isChanged = true;
}

void NoiseHistory::wasSaved(const SavedState& saved, const Scene& scene) {
    if (!saved.hasBodies) return;
    // A changed state belongs to no trajectory before its first step.
    const int stretch = !loading                                ? present.id
                        : loading->point && !loading->isChanged ? loading->point->stretch
                                                                : 0;
    remember(points, {saved.seed, saved.stepNumber, saved.positionsHash, saved.velocitiesHash,
                      hashOfSettings(scene), stretch});
}

void NoiseHistory::willLoad(const SavedState& saved, const Scene& scene) {
    endStretch(scene);
    loading = Loading();
    loading->positions = saved.positionsHash;
    loading->velocities = saved.velocitiesHash;
    for (auto point = points.rbegin(); point != points.rend() && !loading->point; ++point)
        if (point->seed == saved.seed && point->step == saved.stepNumber &&
            point->positions == saved.positionsHash && point->velocities == saved.velocitiesHash)
            loading->point = *point;
}

void NoiseHistory::loadedWasCompared(bool agrees) {
    if (!loading) return;
    loading->wasCompared = true;
    loading->isChanged = !agrees;
}

/** Whether positions and velocities are those that were loaded, to the last bit. */
bool NoiseHistory::hasArraysOf(const Scene& scene, const Loading& loading) {
    return hashOf(scene.arrays->positions()) == loading.positions &&
           (hashOf(scene.arrays->velocities()) == loading.velocities ||
            !scene.settings.hasMomenta());
}

optional<uint32_t> NoiseHistory::seedForStep(const Scene& scene) {
    if (!loading && !isNew) return nullopt;
    const NoiseStream& noise = scene.settings.noise;
    Start start;
    start.settings = hashOfSettings(scene);
    if (!loading) {
        start.arrays = hashOfArrays(*scene.arrays);
        present.start = start;
        isNew = false;
        return nullopt;
    }
    const Loading from = *loading;
    loading.reset();
    const bool isChanged = from.isChanged && !hasArraysOf(scene, from);
    // Platforms round what they load, but an unchanged state can be told by its own hashes.
    start.arrays = isChanged ? hashOfArrays(*scene.arrays) : mixed(from.positions, from.velocities);
    bool needsOwn = isChanged || (from.point && from.point->settings != start.settings);
    // From an unchanged point the trajectory goes on, or is repeated.
    int id = from.point && !needsOwn ? from.point->stretch : 0;
    for (const Stretch& other : stretches) {
        if (needsOwn) break;
        if (other.seed != noise.seed || noise.step < other.begin || noise.step >= other.end ||
            other.id == id)
            continue;
        if (noise.step == other.begin && other.start == start)
            id = other.id;  // another repetition
        else
            // Of a state from elsewhere nothing is known but where it begins.
            needsOwn = from.point || noise.step == other.begin;
    }
    optional<uint32_t> own;
    if (needsOwn) {
        uint64_t hash = mixed(mixed(start.arrays, start.settings), noise.seed);
        hash = mixed(hash, static_cast<uint64_t>(noise.step));
        own = static_cast<uint32_t>(hash ^ (hash >> 32));
        if (*own == 0) own = 1;  // 0 stands for a fresh seed elsewhere
        id = 0;
    }
    beginStretch(own ? *own : noise.seed, scene);
    if (id) present.id = id;
    present.start = start;
    isNew = false;
    return own;
}

}  // namespace RigidHIPlugin
