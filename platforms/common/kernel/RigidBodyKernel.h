#ifndef RIGIDHI_RIGID_BODY_KERNEL_H_
#define RIGIDHI_RIGID_BODY_KERNEL_H_

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "context/BodyAccess.h"
#include "context/ContextMirror.h"
#include "context/Scene.h"
#include "openmmrigidhi/RigidHIKernels.h"
#include "stepping/Stepper.h"

namespace RigidHIPlugin {

/**
 * The parts of the kernel that each platform has of its own. Both are called once for each Context.
 */
struct PlatformParts {
    /** Makes access to the platform's particles. */
    std::function<std::unique_ptr<ContextArrays>(OpenMM::ContextImpl& context)> arrays;
    /** Makes the platform's loops over bodies. */
    std::function<std::unique_ptr<PlatformLoops>(OpenMM::ContextImpl& context)> loops;
};

/**
 * The integrator's kernel of every platform. It passes each call on to the class that does the
 * work.
 */
class RigidBodyKernel : public IntegrateRigidBodiesKernel {
public:
    RigidBodyKernel(const std::string& name, const OpenMM::Platform& platform,
                    const PlatformParts& parts)
        : IntegrateRigidBodiesKernel(name, platform), parts(parts) {}
    void initialize(OpenMM::ContextImpl& context,
                    const CustomRigidHIIntegrator& integrator) override;
    void step(OpenMM::ContextImpl& context, int steps) override;
    void stateChanged(OpenMM::ContextImpl& context, OpenMM::State::DataType changed) override;
    void resetBodyGeometry(OpenMM::ContextImpl& context) override;
    void requireGeometry(OpenMM::ContextImpl& context) override;
    int getNumBodies() const override { return scene->definitions.getNumBodies(); }
    int getRandomNumberSeed() const override {
        return static_cast<int>(scene->settings.noise.seed);
    }
    void setRandomNumberSeed(int seed) override { scene->settings.noise.seed = seedOrFresh(seed); }
    std::vector<OpenMM::Vec3> getBodyPositions(OpenMM::ContextImpl& context) override;
    std::vector<QuaternionArray> getBodyOrientations(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> getBodyVelocities(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> getBodyAngularVelocities(OpenMM::ContextImpl& context) override;
    void setBodyPositions(OpenMM::ContextImpl& context,
                          const std::vector<OpenMM::Vec3>& positions) override;
    void setBodyOrientations(OpenMM::ContextImpl& context,
                             const std::vector<QuaternionArray>& orientations) override;
    void setBodyVelocities(OpenMM::ContextImpl& context,
                           const std::vector<OpenMM::Vec3>& velocities) override;
    void setBodyAngularVelocities(OpenMM::ContextImpl& context,
                                  const std::vector<OpenMM::Vec3>& angularVelocities) override;
    std::vector<OpenMM::Vec3> getBodyForces(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> getBodyTorques(OpenMM::ContextImpl& context) override;
    double getPoseResidual(OpenMM::ContextImpl& context) override;
    double computeTranslationalKineticEnergy(OpenMM::ContextImpl& context) override;
    OpenMM::Vec3 computeRotationalKineticEnergies(OpenMM::ContextImpl& context) override;
    double computeFreeParticleKineticEnergy(OpenMM::ContextImpl& context) override;
    std::map<std::string, int> getDegreesOfFreedom(OpenMM::ContextImpl& context) override;
    std::map<std::string, double> computeMidStepTemperatures(OpenMM::ContextImpl& context) override;
    std::map<std::string, std::string> getEffects(OpenMM::ContextImpl& context) override;
    std::string describeEffects(OpenMM::ContextImpl& context) override;
    std::map<std::string, double> getStepStatistics(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> drawVelocities(OpenMM::ContextImpl& context, double temperature,
                                             int seed) override;
    void updateFluid(OpenMM::ContextImpl& context, const MobilityForce& force) override;
    std::vector<double> getMobility(OpenMM::ContextImpl& context) override;
    std::vector<double> getFriction(OpenMM::ContextImpl& context) override;
    std::vector<double> applyMobility(OpenMM::ContextImpl& context,
                                      const std::vector<double>& wrenches) override;
    std::vector<double> applyBlobMobility(OpenMM::ContextImpl& context,
                                          const std::vector<double>& forces) override;
    std::vector<OpenMM::Vec3> getFlow(OpenMM::ContextImpl& context,
                                      const std::vector<OpenMM::Vec3>& points) override;
    std::vector<double> getFlowMode(OpenMM::ContextImpl& context, int forceAxis, int waveAxis,
                                    int waveVectorIndex, bool randomOnly) override;
    int getNumRejectedSteps(OpenMM::ContextImpl& context) override;
    void createCheckpoint(OpenMM::ContextImpl& context, std::ostream& stream) override;
    void loadCheckpoint(OpenMM::ContextImpl& context, std::istream& stream) override;
    void serialize(OpenMM::ContextImpl& context, OpenMM::SerializationNode& node) override;
    void deserialize(OpenMM::ContextImpl& context, const OpenMM::SerializationNode& node) override;

private:
    const PlatformParts parts;
    std::unique_ptr<Scene> scene;
    std::unique_ptr<ContextMirror> mirror;
    std::unique_ptr<BodyAccess> access;
    std::unique_ptr<Stepper> stepper;
};

}  // namespace RigidHIPlugin

#endif
