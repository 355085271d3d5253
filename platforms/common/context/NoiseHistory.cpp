#include "context/NoiseHistory.h"

#include <array>
#include <cstring>
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

/** Positions, momenta and all else that a body has. */
uint64_t addBody(uint64_t hash, const array<double, 13>& stored) {
    for (double value : stored) {
        uint64_t word;
        memcpy(&word, &value, sizeof word);
        hash = mixed(hash, word);
    }
    return hash;
}

uint64_t hashOfSettings(const Scene& scene) {
    string settings;
    const auto add = [&](double value) {
        settings.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    for (double value : {integrator.getTemperature(), integrator.getFriction(),
                         integrator.getRotationalFriction(), integrator.getStepSize()})
        add(value);
    add(integrator.getScheme());
    for (const auto& parameter : scene.contextParameters) {
        settings += parameter.first;
        add(parameter.second);
    }
    return hashOf(settings);
}

/** A seed that follows from a state, its settings, and the random numbers that it had. */
uint32_t seedFrom(uint64_t numbers, uint64_t settings, const NoiseStream& noise) {
    uint64_t hash = mixed(mixed(numbers, settings), noise.seed);
    hash = mixed(hash, static_cast<uint64_t>(noise.step));
    const uint32_t seed = static_cast<uint32_t>(hash ^ (hash >> 32));
    return seed == 0 ? 1 : seed;  // 0 stands for a fresh seed elsewhere
}

}  // namespace

uint64_t NoiseHistory::Numbers::hash() const { return mixed(mixed(positions, velocities), bodies); }

NoiseHistory::Numbers NoiseHistory::numbersOf(const SavedState& saved) {
    Numbers numbers{saved.positionsHash, saved.velocitiesHash, 0};
    for (const SavedBody& body : saved.bodies)
        numbers.bodies = addBody(numbers.bodies, body.stored);
    return numbers;
}

NoiseHistory::Numbers NoiseHistory::numbersOf(const Scene& scene) {
    ContextArrays& arrays = *scene.arrays;
    const bool isExact = arrays.rounding().isExact();
    Numbers numbers;
    numbers.positions = isExact ? hashOf(arrays.positions()) : hashOfRounded(arrays.positions());
    numbers.velocities = isExact ? hashOf(arrays.velocities()) : hashOfRounded(arrays.velocities());
    for (int b = 0; b < scene.bodies.getNumBodies(); b++)
        numbers.bodies = addBody(numbers.bodies, scene.bodies.getStoredState(b));
    return numbers;
}

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
    present.hasUsersSeed = true;
    loading.reset();
}

void NoiseHistory::stateWasSet(const Scene& scene) {
    if (!loading) {
        const bool hasUsersSeed = present.hasUsersSeed;
        endStretch(scene);
        beginStretch(present.seed, scene);
        present.hasUsersSeed = hasUsersSeed;
    } else if (loading->wasCompared)
        // Before the comparison OpenMM itself sets what it loads.
        loading->wasSet = true;
}

uint32_t NoiseHistory::seedToSave(const Scene& scene) const {
    return loading && loading->mayBeChanged() ? beginAfter(*loading, scene).seed
                                              : scene.settings.noise.seed;
}

void NoiseHistory::wasSaved(const SavedState& saved, const Scene& scene) {
    if (!saved.hasBodies) return;
    const uint64_t settings = hashOfSettings(scene);
    int stretch = present.id;
    if (loading) {
        // A changed state belongs to no trajectory before its first step.
        const Point* point = loading->mayBeChanged() ? nullptr : findPoint(*loading, settings);
        stretch = point ? point->stretch : 0;
    }
    remember(points, {saved.seed, saved.stepNumber, numbersOf(saved), settings, stretch});
}

void NoiseHistory::willLoad(const SavedState& saved, const Scene& scene) {
    endStretch(scene);
    loading.reset();
    if (saved.hasBodies) {
        loading = Loading();
        loading->seed = saved.seed;
        loading->step = saved.stepNumber;
        loading->numbers = numbersOf(saved);
        return;
    }
    beginStretch(saved.seed, scene);  // with positions that are still to be set
    present.begin = saved.stepNumber;
}

void NoiseHistory::loadedWasCompared(bool agrees) {
    if (!loading) return;
    loading->wasCompared = true;
    loading->disagrees = !agrees;
}

const NoiseHistory::Point* NoiseHistory::findPoint(const Loading& from, uint64_t settings) const {
    const Point* found = nullptr;
    for (const Point& point : points)
        if (point.seed == from.seed && point.step == from.step && point.numbers == from.numbers &&
            (!found || point.settings == settings || found->settings != settings))
            found = &point;
    return found;
}

/**
 * OpenMM saves the arrays of a checkpoint before the bodies, which may still write to them. Such a
 * state disagrees when it is compared, but not in the end.
 */
bool NoiseHistory::Loading::isChanged(const Scene& scene, const Numbers& now) const {
    const bool sameArrays = now.positions == numbers.positions &&
                            (now.velocities == numbers.velocities || !scene.settings.hasMomenta());
    return (disagrees && !sameArrays) || (wasSet && !(sameArrays && now.bodies == numbers.bodies));
}

NoiseHistory::Beginning NoiseHistory::beginAfter(const Loading& from, const Scene& scene) const {
    const NoiseStream& noise = scene.settings.noise;
    Beginning result;
    result.start.settings = hashOfSettings(scene);
    result.seed = noise.seed;
    const Numbers now = numbersOf(scene);
    const bool isChanged = from.isChanged(scene, now);
    // Platforms round what they load, but an unchanged state can be told by its own hashes.
    result.start.numbers = isChanged ? now.hash() : from.numbers.hash();
    const Point* point = findPoint(from, result.start.settings);
    bool needsOwn = isChanged || (point && point->settings != result.start.settings);
    // From an unchanged point the trajectory goes on, or is repeated.
    if (point && !needsOwn) result.id = point->stretch;
    for (const Stretch& other : stretches) {
        if (needsOwn) break;
        if (other.seed != noise.seed || noise.step < other.begin || noise.step >= other.end ||
            other.id == result.id)
            continue;
        if (noise.step == other.begin && other.start == result.start)
            result.id = other.id;  // another repetition
        else
            // Of a state from elsewhere nothing is known but where it begins.
            needsOwn = point || noise.step == other.begin;
    }
    if (!needsOwn) return result;
    result.seed = seedFrom(result.start.numbers, result.start.settings, noise);
    result.id = 0;
    for (const Stretch& other : stretches)
        if (other.seed == result.seed && other.begin == noise.step && other.start == result.start)
            result.id = other.id;
    return result;
}

optional<uint32_t> NoiseHistory::seedForStep(const Scene& scene) {
    if (!loading && !isNew) return nullopt;
    const NoiseStream& noise = scene.settings.noise;
    isNew = false;
    if (!loading) {
        present.start.settings = hashOfSettings(scene);
        present.start.numbers = numbersOf(scene).hash();
        if (present.hasUsersSeed) return nullopt;
        bool isUsed = false;
        int id = 0;
        for (const Stretch& other : stretches)
            if (other.seed == noise.seed && noise.step >= other.begin && noise.step < other.end) {
                if (noise.step == other.begin && other.start == present.start)
                    id = other.id;
                else
                    isUsed = true;
            }
        if (id) present.id = id;
        if (id || !isUsed) return nullopt;
        present.seed = seedFrom(present.start.numbers, present.start.settings, noise);
        return present.seed;
    }
    const Beginning next = beginAfter(*loading, scene);
    loading.reset();
    const bool isOwn = next.seed != noise.seed;
    beginStretch(next.seed, scene);
    if (next.id) present.id = next.id;
    present.start = next.start;
    isNew = false;
    return isOwn ? optional<uint32_t>(next.seed) : nullopt;
}

}  // namespace RigidHIPlugin
