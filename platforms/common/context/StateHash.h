#ifndef RIGIDHI_STATE_HASH_H_
#define RIGIDHI_STATE_HASH_H_

#include <openmm/Vec3.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace RigidHIPlugin {

/** A hash of bits (FNV-1a, by words where there are whole words). */
inline uint64_t hashOf(const std::string& bytes) {
    uint64_t hash = 0xcbf29ce484222325u;
    for (unsigned char c : bytes) hash = (hash ^ c) * 0x100000001b3u;
    return hash;
}

/**
 * A hash that identifies an array of positions or velocities after a checkpoint or State was
 * loaded.
 */
inline uint64_t hashOf(const std::vector<OpenMM::Vec3>& v) {
    uint64_t hash = 0xcbf29ce484222325u;
    for (const OpenMM::Vec3& x : v)
        for (int k = 0; k < 3; k++) {
            const double component = x[k];
            uint64_t word;
            __builtin_memcpy(&word, &component, sizeof word);
            hash = (hash ^ word) * 0x100000001b3u;
            hash ^= hash >> 29;  // FNV alone does not carry high bits down
        }
    return hash;
}

/** Whether two arrays are the same to the last bit. */
inline bool sameBits(const std::vector<OpenMM::Vec3>& a, const std::vector<OpenMM::Vec3>& b) {
    return a.size() == b.size() &&
           std::memcmp(a.data(), b.data(), a.size() * sizeof(OpenMM::Vec3)) == 0;
}

}  // namespace RigidHIPlugin

#endif
