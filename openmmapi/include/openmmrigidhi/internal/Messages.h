#ifndef RIGIDHI_MESSAGES_H_
#define RIGIDHI_MESSAGES_H_

#include <openmm/Vec3.h>

#include <cmath>
#include <sstream>
#include <string>
#include <type_traits>

namespace RigidHIPlugin {

/** A value as text for messages, with enough digits to tell two different values apart. */
template <class T>
std::string text(const T& value, int precision = 12) {
    // Checks make this text even if their value is right, and making a stream takes a microsecond.
    if constexpr (std::is_integral_v<T>) return std::to_string(value);
    std::ostringstream stream;
    stream.precision(precision);
    stream << value;
    return stream.str();
}

inline std::string text(const OpenMM::Vec3& v) {
    return "(" + text(v[0]) + ", " + text(v[1]) + ", " + text(v[2]) + ")";
}

/** A number in a sentence, where six digits are enough. */
inline std::string number(double x) { return text(x, 6); }

/** "1 body", "2 bodies". */
inline std::string counted(long n, const char* one, const char* many) {
    return std::to_string(n) + " " + (n == 1 ? one : many);
}

inline bool isFinite(const OpenMM::Vec3& v) {
    return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
}

}  // namespace RigidHIPlugin

#endif
