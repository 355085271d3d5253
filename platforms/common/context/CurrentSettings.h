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

    /** Give warnings that depend on the steps so far. To be called now and then. */
    void warnOfSteps(const Scene& scene);
    /**
     * Give the warning about a barostat's temperature. To be called when a step begins: between
     * steps users set one temperature after the other.
     */
    void warnOfBarostat(const Scene& scene);

private:
    void setThermostats(Scene& scene);
    void printWarnings(const Scene& scene);
    void printOnce(WarningCause cause, const std::string& text);
    std::optional<std::pair<int, double> >
        takenOver;  // the integrator's version of its settings, and its step size
    std::set<WarningCause> printed;
};

}  // namespace RigidHIPlugin

#endif
