#ifndef RIGIDHI_ADOPTED_SETTINGS_H_
#define RIGIDHI_ADOPTED_SETTINGS_H_

#include <optional>
#include <utility>

#include "context/Warnings.h"
#include "host/StepSettings.h"

namespace RigidHIPlugin {

/**
 * Adopts the integrator's settings for steps. It checks and copies them when users have changed
 * any, and makes the thermostats that depend on them.
 */
class AdoptedSettings : public StepSettings {
public:
    /**
     * Check and adopt the settings.
     *
     * @return warnings about the settings
     * @throws OpenMMException
     */
    Warnings adopt(Scene& scene);
    /** Forget the adopted settings, because bodies or fluid, on which they depend, have changed. */
    void forget() { adopted.reset(); }
    /** Whether nothing has changed since adopt(). */
    bool areAdopted(const CustomRigidHIIntegrator& integrator) const;
    /** How often settings were adopted. */
    long long getVersion() const { return version; }

private:
    void setThermostats(Scene& scene);
    long long version = 0;
    std::optional<std::pair<int, double>>
        adopted;  // the integrator's version of its settings, and its step size
};

}  // namespace RigidHIPlugin

#endif
