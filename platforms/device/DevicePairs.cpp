#include "DevicePairs.h"

#include <openmm/OpenMMException.h>
#include <openmm/common/ContextSelector.h>

#include <algorithm>
#include <iostream>

#include "mobility/Accuracy.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** This many groups of threads keep any device busy. */
const int wantedGroups = 2048;
/**
 * The limit of partial sums. Columns of forces that need more are multiplied one after the other.
 */
const double mostNumbers = 1 << 23;

/**
 * Make room for `size` values, and at most for twice as many, since OpenMM transfers whole arrays.
 */
template <class T>
void reserve(const Device& device, ComputeArray& array, size_t size, const char* name) {
    const size_t held = array.isInitialized() ? array.getSize() : 0;
    if (held < size || held > 2 * size) device.reserve<T>(array, size, name);
}

template <class T>
void give(const Device& device, ComputeArray& array, vector<T>& values, const char* name) {
    reserve<T>(device, array, values.size(), name);
    values.resize(array.getSize());
    device.give(array, values, name);
}

}  // namespace

struct DevicePairs::Kernels {
    ComputeProgram program;
    ComputeKernel pairs, chunks;
};

DevicePairs::DevicePairs(unique_ptr<const Device> device, const string& platform, ProductWish wish)
    : device(move(device)), cc(this->device->getContext()), platform(platform), wish(wish) {}

DevicePairs::~DevicePairs() = default;

string DevicePairs::reasonForHost() const {
    if (wish == ProductWish::Host) return "the environment variable RIGIDHI_PRODUCTS is host";
    if (!device->hasDoubles())
        return "the device has no double precision, which sums of many particles need";
    if (wish == ProductWish::Auto && cc.getIsCPU())
        return "the device is a CPU, on which the host's own products take less time";
    const lock_guard<std::mutex> lock(mutex);
    return broken;
}

bool DevicePairs::serves(int numParticles, bool hasWall, bool hasMultipoles, double error) const {
    if (error < Accuracy::errorOfSinglePrecision || !reasonForHost().empty()) return false;
    return wish == ProductWish::Device ||
           deviceIsFaster(numParticles, hasWall, hasMultipoles, error);
}

bool DevicePairs::isOn() const {
    if (!reasonForHost().empty()) return false;
    const lock_guard<std::mutex> lock(mutex);
    return !sizes.empty();
}

string DevicePairs::describe() const {
    const string reason = reasonForHost();
    if (!reason.empty()) return "the host makes all products: " + reason;
    const lock_guard<std::mutex> lock(mutex);
    if (sizes.empty())
        return "no fluid needs products with the mobility of " + to_string(fewestForDevice(false)) +
               " particles or more, which would take less time on the device";
    const string most = to_string(*sizes.rbegin()),
                 numbers = *sizes.begin() == *sizes.rbegin()
                               ? most
                               : to_string(*sizes.begin()) + " to " + most;
    return "products with the mobility of " + numbers +
           " particles, where they may have errors of 1e-6, are sums over all pairs on platform " +
           platform + ", in floats with sums in double precision" +
           (wish == ProductWish::Device ? "; RIGIDHI_PRODUCTS is device" : "");
}

DevicePairs::Note::Note(DevicePairs& pairs, int numParticles)
    : pairs(pairs), numParticles(numParticles) {
    const lock_guard<std::mutex> lock(pairs.mutex);
    pairs.sizes.insert(numParticles);
}

DevicePairs::Note::~Note() {
    const lock_guard<std::mutex> lock(pairs.mutex);
    pairs.sizes.erase(pairs.sizes.find(numParticles));
}

void DevicePairs::PlacedSpheres::moveTo(const vector<double>& positions) {
    places.resize(radii.size());
    remainders.resize(radii.size());
    for (size_t i = 0; i < radii.size(); i++) {
        float high[3], low[3];
        for (int k = 0; k < 3; k++) {
            high[k] = static_cast<float>(positions[3 * i + k]);
            low[k] = static_cast<float>(positions[3 * i + k] - high[k]);
        }
        places[i] = mm_float4(high[0], high[1], high[2], static_cast<float>(radii[i]));
        remainders[i] = mm_float4(low[0], low[1], low[2], 0);
    }
    isOnDevice = false;
}

DevicePairs::Kernels& DevicePairs::kernelsFor(PairKind kind) {
    unique_ptr<Kernels>& found = kernels[kind.hasTorque][kind.hasWall];
    if (found) return *found;
    const KernelProgram text = pairProgram(kind);
    auto made = make_unique<Kernels>();
    made->program = device->compile(text);
    made->pairs = made->program->createKernel("addPairs");
    made->chunks = made->program->createKernel("addChunks");
    for (int k = 0; k < 9; k++) made->pairs->addArg();
    for (int k = 0; k < 4; k++) made->chunks->addArg();
    found = move(made);
    return *found;
}

bool DevicePairs::multiply(PlacedSpheres& place, const Eigen::MatrixXd& loads,
                           Eigen::MatrixXd& sums) {
    const lock_guard<std::mutex> lock(mutex);
    if (!broken.empty()) return false;
    try {
        const ContextSelector selector(cc);
        sums.resize(loads.rows(), loads.cols());
        const double ofColumn = static_cast<double>(loads.rows()) * (wantedGroups * pairGroup) /
                                max<size_t>(1, place.radii.size());
        const int most = max(1.0, mostNumbers / max<double>(loads.rows(), ofColumn));
        for (int column = 0; column < loads.cols(); column += most)
            sum(place, loads, column, min<int>(most, loads.cols() - column), sums);
        return true;
    } catch (const exception& error) {  // from OpenMM, or for lack of memory on the host
        broken = string("the device could not make one: ") + error.what();
    }
    buffers.reset();
    place.there.reset();
    place.isOnDevice = false;
    cerr << "Warning: openmm-rigidhi: the host makes products with mobilities; " << broken << endl;
    return false;
}

void DevicePairs::sum(PlacedSpheres& place, const Eigen::MatrixXd& loads, int column, int columns,
                      Eigen::MatrixXd& sums) {
    const int n = place.radii.size(), components = place.kind.hasTorque ? 6 : 3;
    Kernels& k = kernelsFor(place.kind);
    if (!buffers) buffers = make_unique<Buffers>();
    Buffers& b = *buffers;
    if (!place.there) place.there = make_unique<PlacedSpheres::There>();
    if (!place.isOnDevice) {
        give(*device, place.there->places, place.places, "places");
        give(*device, place.there->remainders, place.remainders, "remainders");
        place.isOnDevice = true;
    }
    // The number of chunks follows from the number of particles alone, so sums do not depend on the
    // device.
    const int blocks = (n + pairGroup - 1) / pairGroup, tiles = (n + pairTile - 1) / pairTile;
    const int wanted = max(1, wantedGroups / blocks), tilesOfChunk = (tiles + wanted - 1) / wanted,
              chunks = (tiles + tilesOfChunk - 1) / tilesOfChunk;
    const int numSums = n * components * columns;

    forceValues.assign(static_cast<size_t>(n) * columns, mm_float4(0, 0, 0, 0));
    torqueValues.assign(place.kind.hasTorque ? forceValues.size() : 1, mm_float4(0, 0, 0, 0));
    for (int c = 0; c < columns; c++)
        for (int i = 0; i < n; i++) {
            const double* load = loads.data() + loads.rows() * (column + c) + components * i;
            const size_t to = static_cast<size_t>(n) * c + i;
            forceValues[to] = mm_float4(load[0], load[1], load[2], 0);
            if (place.kind.hasTorque) torqueValues[to] = mm_float4(load[3], load[4], load[5], 0);
        }
    give(*device, b.forces, forceValues, "forces");
    give(*device, b.torques, torqueValues, "torques");
    reserve<double>(*device, b.partialSums, static_cast<size_t>(numSums) * chunks, "partialSums");
    reserve<double>(*device, b.sums, numSums, "sums");

    k.pairs->setArg(0, place.there->places);
    k.pairs->setArg(1, place.there->remainders);
    k.pairs->setArg(2, b.forces);
    k.pairs->setArg(3, b.torques);
    k.pairs->setArg(4, b.partialSums);
    k.pairs->setArg(5, n);
    k.pairs->setArg(6, columns);
    k.pairs->setArg(7, chunks);
    k.pairs->setArg(8, tilesOfChunk * pairTile);
    k.pairs->execute(blocks * chunks * columns * pairGroup, pairGroup);
    k.chunks->setArg(0, b.partialSums);
    k.chunks->setArg(1, b.sums);
    k.chunks->setArg(2, numSums);
    k.chunks->setArg(3, chunks);
    k.chunks->execute(numSums);
    b.sums.download(sumValues);
    for (int c = 0; c < columns; c++)
        for (int j = 0; j < components; j++) {
            const double* from = sumValues.data() + static_cast<size_t>(c * components + j) * n;
            for (int i = 0; i < n; i++) sums(components * i + j, column + c) = from[i];
        }
}

}  // namespace RigidHIPlugin
