#ifndef RIGIDHI_CURRENT_SETTINGS_H_
#define RIGIDHI_CURRENT_SETTINGS_H_

#include <optional>
#include <set>
#include <utility>

#include "context/Warnings.h"
#include "host/StepSettings.h"

namespace RigidHIPlugin {

/**
 * The integrator's settings as steps use them. They are taken over when users have changed any,
 * together with the thermostats that depend on them.
 */
class CurrentSettings : public StepSettings {
public:
    /**
     * Check and take over the settings, if any was changed since the last time. @throws
     * OpenMMException
     */
    void update(Scene& scene);
    /**
     * Bodies or fluid, which the settings depend on, have changed. The next update() takes the
     * settings over in any case.
     */
    void forget() { takenOver.reset(); }

    /**
     * Give the warning about drift factors, which depends on the steps so far. To be called after
     * each step.
     */
    void warnOfDriftFactor(const Scene& scene);
    /** Likewise of temperatures that the watch has found wrong. */
    void warnOfTemperatures(const Scene& scene);

private:
    void setThermostats(Scene& scene);
    void printWarnings(const Scene& scene);
    std::optional<std::pair<int, double> >
        takenOver;  // the integrator's version of its settings, and its step size
    std::set<WarningCause> printed;
};

}  // namespace RigidHIPlugin

#endif
