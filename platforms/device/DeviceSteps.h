#ifndef RIGIDHI_DEVICE_STEPS_H_
#define RIGIDHI_DEVICE_STEPS_H_

#include <openmm/common/ComputeContext.h>
#include <openmm/internal/ContextImpl.h>

#include <string>

#include "DeviceBodies.h"
#include "context/ActingForces.h"
#include "host/NativeSteps.h"
#include "stepping/Stepper.h"

namespace RigidHIPlugin {

/**
 * Steps of bodies on the device, beside the forces: thermostats, and LangevinHI where the fluid
 * couples nothing. Within step(n) nothing is transferred but a flag every hundred steps.
 *
 * A step goes as on the host (Stepper): Forces that act on the state, and what they changed -> the
 * scheme up to new positions -> forces -> the rest of the scheme. A number that is not finite stops
 * the kernels. The steps since the last look at the flag are then taken again by the host, which
 * says which step and body it was.
 */
class DeviceSteps : public NativeSteps {
public:
    /** @param cc  the context of the platform's first device */
    DeviceSteps(OpenMM::ComputeContext& cc, OpenMM::ContextImpl& context, Scene& scene,
                ContextMirror& mirror, Stepper& stepper);
    bool take(int number) override;
    void bringBack() override;
    bool isActedOn() const override { return actsOn; }
    std::string reasonForHost() const override;
    std::string describe() const override;
    Counts getCounts() const override { return bodies.getCounts(); }

private:
    /** What a step changes beside the states of bodies. */
    struct Start {
        OpenMM::Vec3 box[3];
        double time = 0;
        long long stepCount = 0, noiseStep = 0, steps = 0;
        StepCounters counters;
    };
    std::string conditionForHost() const;
    bool begin();
    void takeStep();
    void letForcesAct();
    void placeVirtualSites();
    void calculateForces();
    void keepStart();
    void look();
    void stepByHost();
    OpenMM::ComputeContext& cc;
    OpenMM::ContextImpl& context;
    Scene& scene;
    ContextMirror& mirror;
    Stepper& stepper;
    const ActingForces acting;
    DeviceBodies bodies;
    Start start;
    bool actsOn = false;  // Forces act on the state at present
    bool isHere = false;  // bodies are on the device, and those of the host are out of date
    long long steps = 0, lastLook = 0;
    std::string ownReason;      // why this device cannot take any steps
    std::string passingReason;  // why it could not take the last ones
};

}  // namespace RigidHIPlugin

#endif
