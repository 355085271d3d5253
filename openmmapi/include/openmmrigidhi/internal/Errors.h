#ifndef RIGIDHI_ERRORS_H_
#define RIGIDHI_ERRORS_H_

#include <openmm/OpenMMException.h>

#include <string>

#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

/**
 * Throws the errors of one class, whose name begins the message. A source file calls its object
 * `fail`, or by a name that begins with `fail`.
 */
class ErrorsOf {
public:
    explicit constexpr ErrorsOf(const char* className) : className(className) {}
    [[noreturn]] void operator()(const std::string& message) const {
        throw OpenMM::OpenMMException(className + (": " + message));
    }
    /** @param object  what the message is about, such as a method or a body */
    [[noreturn]] void operator()(const std::string& object, const std::string& message) const {
        (*this)(object + ": " + message);
    }
    /** Without a remedy, where the bound already says what to do. */
    [[noreturn]] void operator()(const std::string& object, const std::string& problem,
                                 const std::string& bound) const {
        (*this)(object, problem + "; " + bound);
    }
    /** The form of all messages about arguments: object, its value, the bound that the value
     * breaks, and the remedy. */
    [[noreturn]] void operator()(const std::string& object, const std::string& problem,
                                 const std::string& bound, const std::string& remedy) const {
        (*this)(object, problem + "; " + bound + ": " + remedy);
    }

private:
    const char* className;
};

/** Errors of the fluid's settings that platforms find. */
inline constexpr ErrorsOf failFluid{"MobilityForce"};

}  // namespace RigidHIPlugin

#endif
