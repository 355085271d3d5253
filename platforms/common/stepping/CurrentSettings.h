#ifndef RIGIDHI_CURRENT_SETTINGS_H_
#define RIGIDHI_CURRENT_SETTINGS_H_

#include <optional>
#include <set>
#include <utility>

#include "context/Warnings.h"
#include "stepping/StepSettings.h"

namespace RigidHIPlugin {

/** The integrator's settings as steps use them. They are taken over when users have changed any,
 * with the thermostats that follow. */
class CurrentSettings : public StepSettings {
public:
    /** Check and take over, if anything was changed since the last time. @throws OpenMMException */
    void update(Scene& scene);
    /** What the settings stand on (bodies, fluid) has changed: the next update() takes them over
     * whatever they are. */
    void forget() { takenOver.reset(); }

    /** The warning about drift factors, which takes steps to be known; after each of them. */
    void warnOfDriftFactor(const Scene& scene);

private:
    void setThermostats(Scene& scene);
    void printWarnings(const Scene& scene);
    std::optional<std::pair<int, double> >
        takenOver;  // the integrator's version of its settings, and its step size
    std::set<WarningCause> printed;
};

}  // namespace RigidHIPlugin

#endif
