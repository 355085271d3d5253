#ifndef OPENMMRIGIDHI_ENUM_NAMES_H_
#define OPENMMRIGIDHI_ENUM_NAMES_H_

#include <algorithm>
#include <map>
#include <string>

#include "openmmrigidhi/internal/StrictNode.h"

namespace RigidHIPlugin {

/** Enumerators in XML are names, not numbers, so that files outlive a reordering of the enums. */
template <class Enum>
using EnumNames = std::map<std::string, Enum>;

/**
 * Every enumerator is in its table, because the setters take no other values and a test writes each
 * enumerator.
 */
template <class Enum>
std::string nameOf(const EnumNames<Enum>& names, Enum value) {
    return std::find_if(names.begin(), names.end(),
                        [value](const auto& entry) { return entry.second == value; })
        ->first;
}

template <class Enum>
Enum valueOf(const EnumNames<Enum>& names, const StrictNode& node, const std::string& property) {
    const auto entry = names.find(node.text(property));
    if (entry != names.end()) return entry->second;
    std::string known;
    for (const auto& name : names) known += (known.empty() ? "" : ", ") + name.first;
    node.wrongValue(property, "one of " + known);
}

}  // namespace RigidHIPlugin

#endif
