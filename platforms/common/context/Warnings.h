#ifndef RIGIDHI_WARNINGS_H_
#define RIGIDHI_WARNINGS_H_

#include <map>
#include <string>

namespace RigidHIPlugin {

class Scene;

/**
 * Warnings about the settings. A user gets each cause once, though its numbers may change from step
 * to step.
 */
enum class WarningCause {
    OmittedDrift,
    UnresolvedRotation,
    LargeFriction,
    DriftFactorSpread,
    WrongTemperature
};
/** The spread of drift factors above which they are not a small correction any more. */
constexpr double driftFactorLimit = 0.3;
std::map<WarningCause, std::string> findWarnings(const Scene& scene);

}  // namespace RigidHIPlugin

#endif
