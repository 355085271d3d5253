#ifndef RIGIDHI_RIGID_BODY_KERNEL_H_
#define RIGIDHI_RIGID_BODY_KERNEL_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "context/ContextMirror.h"
#include "context/Scene.h"
#include "host/NativeSteps.h"
#include "openmmrigidhi/RigidHIKernels.h"
#include "stepping/Stepper.h"

namespace RigidHIPlugin {

/**
 * The parts of the kernel that differ between platforms. Each function is called once for each
 * Context.
 */
struct PlatformParts {
    /** Makes access to the platform's particles. */
    std::function<std::unique_ptr<ContextArrays>(OpenMM::ContextImpl& context)> arrays;
    /** Makes the platform's loops over bodies. */
    std::function<std::unique_ptr<PlatformLoops>(OpenMM::ContextImpl& context)> loops;
    /** Makes the platform's own steps. Without this function the host takes all steps. */
    std::function<std::unique_ptr<NativeSteps>(OpenMM::ContextImpl& context, Scene& scene,
                                               ContextMirror& mirror, Stepper& stepper)>
        native = nullptr;
};

/**
 * The integrator's kernel of every platform. It owns the classes that do the work in a Context, and
 * passes each call to one of them.
 */
class RigidBodyKernel : public IntegrateRigidBodiesKernel {
public:
    RigidBodyKernel(const std::string& name, const OpenMM::Platform& platform,
                    const PlatformParts& parts)
        : IntegrateRigidBodiesKernel(name, platform), parts(parts) {}
    void initialize(OpenMM::ContextImpl& context,
                    const CustomRigidHIIntegrator& integrator) override;
    BodiesInContext& getBodies() override {
        bringBack();
        return *bodies;
    }
    FluidInContext& getFluid() override {
        bringBack();
        return *fluid;
    }
    void step(int steps) override;
    void stateChanged(OpenMM::State::DataType changed) override;
    void resetBodyGeometry() override;
    int getRandomNumberSeed() const override {
        return static_cast<int>(scene->settings.noise.seed);
    }
    void setRandomNumberSeed(int seed) override;
    std::vector<OpenMM::Vec3> drawVelocities(double temperature, int seed) override;
    void createCheckpoint(std::ostream& stream) override;
    void loadCheckpoint(std::istream& stream) override;
    void serialize(OpenMM::SerializationNode& node) override;
    void deserialize(const OpenMM::SerializationNode& node) override;

private:
    /** Bring bodies and particles up to date, if the platform itself has moved them. */
    void bringBack() {
        if (native) native->bringBack();
    }
    const PlatformParts parts;
    std::unique_ptr<Scene> scene;
    std::unique_ptr<ContextMirror> mirror;
    std::unique_ptr<Stepper> stepper;
    std::unique_ptr<NativeSteps> native;  // null if the platform has none
    std::unique_ptr<BodiesInContext> bodies;
    std::unique_ptr<FluidInContext> fluid;
};

}  // namespace RigidHIPlugin

#endif
