#ifndef OPENMMRIGIDHI_MODEL_NAMES_H_
#define OPENMMRIGIDHI_MODEL_NAMES_H_

#include <cstddef>
#include <string>

namespace RigidHIPlugin {

// The names of MobilityForce's enumerators, by their numbers: for setters, XML, messages and
// descriptions.

inline constexpr const char* modelNames[] = {
    "FreeDraining",
    "RotnePragerYamakawa",
    "StokesianDynamics",
    "ForceCoupling",
};

inline constexpr const char* boundaryNames[] = {
    "Unbounded",
    "NoSlipWall",
    "Periodic",
    "SlipChannel",
};

template <size_t count>
constexpr int numberOf(const char* const (&)[count]) {
    return count;
}
/** The name of an enumerator; empty for a value that is none. */
template <size_t count>
const char* nameIn(const char* const (&names)[count], int value) {
    return value >= 0 && value < (int)count ? names[value] : "";
}
/** All names, separated by commas. */
template <size_t count>
std::string listOf(const char* const (&names)[count]) {
    std::string list;
    for (const char* name : names) list += (list.empty() ? "" : ", ") + std::string(name);
    return list;
}

}  // namespace RigidHIPlugin

#endif
