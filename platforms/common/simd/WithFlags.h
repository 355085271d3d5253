#ifndef RIGIDHI_WITH_FLAGS_H_
#define RIGIDHI_WITH_FLAGS_H_

#include <type_traits>

namespace RigidHIPlugin {

/**
 * Call task(flags...) with the flags as constants, std::true_type or std::false_type, for use as
 * template arguments. The task is compiled for every combination of flags.
 */
template <class Task>
void withFlags(const Task& task) {
    task();
}
template <class Task, typename... Others>
void withFlags(const Task& task, bool flag, Others... others) {
    if (flag)
        withFlags([&](auto... constants) { task(std::true_type(), constants...); }, others...);
    else
        withFlags([&](auto... constants) { task(std::false_type(), constants...); }, others...);
}

}  // namespace RigidHIPlugin

#endif
