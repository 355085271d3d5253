#ifndef RIGIDHI_MESSAGES_H_
#define RIGIDHI_MESSAGES_H_

#include <openmm/OpenMMException.h>
#include <openmm/Vec3.h>

#include <cmath>
#include <sstream>
#include <string>

namespace RigidHIPlugin {

/** An error of the integrator. */
[[noreturn]] inline void fail(const std::string& message) {
    throw OpenMM::OpenMMException("CustomRigidHIIntegrator: " + message);
}

/** A number as messages show it. */
inline std::string number(double x) {
    std::ostringstream text;
    text << x;
    return text.str();
}

inline bool isFinite(const OpenMM::Vec3& v) {
    return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
}

}  // namespace RigidHIPlugin

#endif
