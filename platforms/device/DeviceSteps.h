#ifndef RIGIDHI_DEVICE_STEPS_H_
#define RIGIDHI_DEVICE_STEPS_H_

#include <openmm/internal/ContextImpl.h>

#include <memory>
#include <string>

#include "DeviceBodies.h"
#include "context/ActingForces.h"
#include "host/NativeSteps.h"
#include "stepping/Stepper.h"

namespace RigidHIPlugin {

/**
 * Steps of bodies on the device, where the forces are: thermostats, and LangevinHI where the fluid
 * couples nothing. Within step(n) nothing is transferred except a flag every hundred steps, a few
 * sums for the watch of temperatures, and images of particles when a barostat tries a move.
 *
 * A step has the order of a step on the host (Stepper): let Forces act that change the state, take
 * in their changes, run the scheme up to new positions, evaluate forces, run the rest of the
 * scheme. A number that is not finite stops the kernels. The host then takes the steps since the
 * last look at the flag again, and names the step and the body.
 */
class DeviceSteps : public NativeSteps {
public:
    /** @param device  the platform's first device */
    DeviceSteps(std::unique_ptr<const Device> device, OpenMM::ContextImpl& context, Scene& scene,
                ContextMirror& mirror, Stepper& stepper);
    bool take(int number) override;
    void bringBack() override;
    bool isActedOn() const override { return actsOn; }
    std::string reasonForHost() const override;
    std::string describe() const override;
    Counts getCounts() const override { return bodies ? bodies->getCounts() : Counts(); }

private:
    /** The data that a step changes, except the states of bodies. */
    struct Start {
        OpenMM::Vec3 box[3];
        double time = 0;
        long long stepCount = 0, noiseStep = 0, steps = 0;
        StepCounters counters;
    };
    bool begin();
    bool upload();
    void takeStep();
    void letForcesAct();
    void placeVirtualSites();
    void calculateForces();
    void checkEnergy();
    void keepStart();
    void look();
    void stepByHost();
    std::string ofImages() const;
    OpenMM::ComputeContext& cc;
    OpenMM::ContextImpl& context;
    Scene& scene;
    ContextMirror& mirror;
    Stepper& stepper;
    const ActingForces acting;
    const int imagesSeenBy;                // forceThatSeesImages() of a periodic System
    std::unique_ptr<DeviceBodies> bodies;  // null if this device can take no steps at all
    Start start;
    bool actsOn = false;  // whether Forces are acting on the state now
    bool isHere = false;  // the device has the current bodies, and the host's are out of date
    bool toldOfRepetition = false;
    long long steps = 0, lastLook = 0;
    std::string ownReason;  // why this device can take no steps at all
};

}  // namespace RigidHIPlugin

#endif
