#ifndef OPENMMRIGIDHI_RIGID_HI_KERNELS_H_
#define OPENMMRIGIDHI_RIGID_HI_KERNELS_H_

#include <openmm/KernelImpl.h>
#include <openmm/Platform.h>
#include <openmm/State.h>
#include <openmm/Vec3.h>
#include <openmm/internal/ContextImpl.h>

#include <iosfwd>
#include <string>
#include <vector>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/internal/BodiesInContext.h"
#include "openmmrigidhi/internal/FluidInContext.h"

namespace RigidHIPlugin {

/**
 * The work of a platform for a CustomRigidHIIntegrator in one Context: the kernel owns the state of
 * the bodies and advances it. getBodies() and getFluid() answer the questions of users.
 */
class IntegrateRigidBodiesKernel : public OpenMM::KernelImpl {
public:
    static std::string Name() { return "IntegrateRigidBodies"; }
    IntegrateRigidBodiesKernel(const std::string& name, const OpenMM::Platform& platform)
        : OpenMM::KernelImpl(name, platform) {}
    /**
     * Check the System against the integrator and set up. Call this method before all others.
     * @throws OpenMMException if a System is refused
     */
    virtual void initialize(OpenMM::ContextImpl& context,
                            const CustomRigidHIIntegrator& integrator) = 0;
    /** The object behind the integrator's getters and setters of the bodies' state. */
    virtual BodiesInContext& getBodies() = 0;
    /** The object behind the MobilityForce's methods ...InContext(). */
    virtual FluidInContext& getFluid() = 0;

    /** Take this many steps. */
    virtual void step(int steps) = 0;
    /** Tell the kernel that the user changed something through the Context. */
    virtual void stateChanged(OpenMM::State::DataType changed) = 0;
    /**
     * Derive implicit geometries, which were forgotten, from the present positions when they are
     * next needed.
     */
    virtual void resetBodyGeometry() = 0;
    /** The seed in use. */
    virtual int getRandomNumberSeed() const = 0;
    /** Use this seed from the next step on; 0: a fresh one. */
    virtual void setRandomNumberSeed(int seed) = 0;
    /**
     * Draw thermal particle velocities. The kernel keeps the velocities and angular velocities of
     * bodies for the setVelocities() that follows.
     */
    virtual std::vector<OpenMM::Vec3> drawVelocities(double temperature, int seed) = 0;

    virtual void createCheckpoint(std::ostream& stream) = 0;
    virtual void loadCheckpoint(std::istream& stream) = 0;
    virtual void serialize(OpenMM::SerializationNode& node) = 0;
    virtual void deserialize(const OpenMM::SerializationNode& node) = 0;
};

}  // namespace RigidHIPlugin

#endif
