#ifndef OPENMMRIGIDHI_RIGID_HI_KERNELS_H_
#define OPENMMRIGIDHI_RIGID_HI_KERNELS_H_

#include <openmm/KernelImpl.h>
#include <openmm/Platform.h>
#include <openmm/State.h>
#include <openmm/Vec3.h>
#include <openmm/internal/ContextImpl.h>

#include <iosfwd>
#include <map>
#include <string>
#include <vector>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * The work of a platform for a CustomRigidHIIntegrator: the kernel owns the state of the bodies and
 * advances it.
 *
 * Users, barostats and minimisers may change the Context's positions and velocities. Every method
 * that looks at the bodies first brings them up to date with such changes, by comparing with what
 * the kernel wrote last.
 */
class IntegrateRigidBodiesKernel : public OpenMM::KernelImpl {
public:
    static std::string Name() { return "IntegrateRigidBodies"; }
    IntegrateRigidBodiesKernel(const std::string& name, const OpenMM::Platform& platform)
        : OpenMM::KernelImpl(name, platform) {}
    /** Check the System against the integrator (throws where it is refused) and set up. */
    virtual void initialize(OpenMM::ContextImpl& context,
                            const CustomRigidHIIntegrator& integrator) = 0;
    /** Take this many steps. */
    virtual void step(OpenMM::ContextImpl& context, int steps) = 0;
    /** The user changed something through the Context. */
    virtual void stateChanged(OpenMM::ContextImpl& context, OpenMM::State::DataType changed) = 0;
    /**
     * Derive implicit geometries, which were forgotten, from the present positions when they are
     * next needed.
     */
    virtual void resetBodyGeometry(OpenMM::ContextImpl& context) = 0;
    /** Make sure that all geometries are known; throws if positions were not set. */
    virtual void requireGeometry(OpenMM::ContextImpl& context) = 0;
    /** The number of bodies of the Context. The integrator may have been given more since. */
    virtual int getNumBodies() const = 0;
    /** The seed in use. */
    virtual int getRandomNumberSeed() const = 0;
    /** Use this seed from the next step on; 0: a fresh one. */
    virtual void setRandomNumberSeed(int seed) = 0;

    virtual std::vector<OpenMM::Vec3> getBodyPositions(OpenMM::ContextImpl& context) = 0;
    virtual std::vector<QuaternionArray> getBodyOrientations(OpenMM::ContextImpl& context) = 0;
    virtual std::vector<OpenMM::Vec3> getBodyVelocities(OpenMM::ContextImpl& context) = 0;
    virtual std::vector<OpenMM::Vec3> getBodyAngularVelocities(OpenMM::ContextImpl& context) = 0;
    virtual void setBodyPositions(OpenMM::ContextImpl& context,
                                  const std::vector<OpenMM::Vec3>& positions) = 0;
    virtual void setBodyOrientations(OpenMM::ContextImpl& context,
                                     const std::vector<QuaternionArray>& orientations) = 0;
    virtual void setBodyVelocities(OpenMM::ContextImpl& context,
                                   const std::vector<OpenMM::Vec3>& velocities) = 0;
    virtual void setBodyAngularVelocities(OpenMM::ContextImpl& context,
                                          const std::vector<OpenMM::Vec3>& angularVelocities) = 0;
    virtual std::vector<OpenMM::Vec3> getBodyForces(OpenMM::ContextImpl& context) = 0;
    virtual std::vector<OpenMM::Vec3> getBodyTorques(OpenMM::ContextImpl& context) = 0;
    virtual double getPoseResidual(OpenMM::ContextImpl& context) = 0;

    virtual double computeTranslationalKineticEnergy(OpenMM::ContextImpl& context) = 0;
    virtual OpenMM::Vec3 computeRotationalKineticEnergies(OpenMM::ContextImpl& context) = 0;
    virtual double computeFreeParticleKineticEnergy(OpenMM::ContextImpl& context) = 0;
    virtual std::map<std::string, int> getDegreesOfFreedom(OpenMM::ContextImpl& context) = 0;
    virtual std::map<std::string, double> computeMidStepTemperatures(
        OpenMM::ContextImpl& context) = 0;
    virtual std::map<std::string, std::string> getEffects(OpenMM::ContextImpl& context) = 0;
    virtual std::string describeEffects(OpenMM::ContextImpl& context) = 0;
    virtual std::map<std::string, double> getStepStatistics(OpenMM::ContextImpl& context) = 0;
    /**
     * Draw thermal particle velocities. The twists of bodies are kept for the setVelocities() that
     * follows.
     */
    virtual std::vector<OpenMM::Vec3> drawVelocities(OpenMM::ContextImpl& context,
                                                     double temperature, int seed) = 0;

    // Requests of a MobilityForce.
    virtual void updateFluid(OpenMM::ContextImpl& context, const MobilityForce& force) = 0;
    virtual std::vector<double> getMobility(OpenMM::ContextImpl& context) = 0;
    virtual std::vector<double> getFriction(OpenMM::ContextImpl& context) = 0;
    virtual std::vector<double> applyMobility(OpenMM::ContextImpl& context,
                                              const std::vector<double>& wrenches) = 0;
    virtual std::vector<double> applyBlobMobility(OpenMM::ContextImpl& context,
                                                  const std::vector<double>& forces) = 0;
    virtual std::vector<OpenMM::Vec3> getFlow(OpenMM::ContextImpl& context,
                                              const std::vector<OpenMM::Vec3>& points) = 0;
    virtual std::vector<double> getFlowMode(OpenMM::ContextImpl& context, int forceAxis,
                                            int waveAxis, int waveVectorIndex, bool randomOnly) = 0;
    virtual int getNumRejectedSteps(OpenMM::ContextImpl& context) = 0;

    virtual void createCheckpoint(OpenMM::ContextImpl& context, std::ostream& stream) = 0;
    virtual void loadCheckpoint(OpenMM::ContextImpl& context, std::istream& stream) = 0;
    virtual void serialize(OpenMM::ContextImpl& context, OpenMM::SerializationNode& node) = 0;
    virtual void deserialize(OpenMM::ContextImpl& context,
                             const OpenMM::SerializationNode& node) = 0;
};

}  // namespace RigidHIPlugin

#endif
