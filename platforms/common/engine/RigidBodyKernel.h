#ifndef RIGIDHI_RIGID_BODY_KERNEL_H_
#define RIGIDHI_RIGID_BODY_KERNEL_H_

#include <openmm/reference/ReferencePlatform.h>

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "engine/Fluid.h"
#include "engine/ForceChoice.h"
#include "engine/FreeParticles.h"
#include "engine/PlatformLoops.h"
#include "engine/SavedState.h"
#include "engine/SystemCheck.h"
#include "forces/BodyForces.h"
#include "openmmrigidhi/RigidHIKernels.h"
#include "rigidbody/BodySet.h"
#include "rigidbody/PoseFit.h"

namespace RigidHIPlugin {

/**
 * The integrator's kernel, but for the loops that platforms do in their own way.
 *
 * A step: (others' changes are taken in) -> forces on particles -> force and torque a body -> scheme -> new poses and
 * momenta -> particle positions -> forces -> scheme -> particle velocities. Forces are evaluated once a step: those at
 * the end of a step serve the next one, unless anything changed in between.
 */
class RigidBodyKernel : public IntegrateRigidBodiesKernel {
public:
    RigidBodyKernel(const std::string& name, const OpenMM::Platform& platform,
                    OpenMM::ReferencePlatform::PlatformData& data);
    void initialize(OpenMM::ContextImpl& context, const CustomRigidHIIntegrator& integrator) override;
    void step(OpenMM::ContextImpl& context) override;
    void stateChanged(OpenMM::ContextImpl& context, OpenMM::State::DataType changed) override;
    void resetBodyGeometry(OpenMM::ContextImpl& context) override;
    void requireGeometry(OpenMM::ContextImpl& context) override;
    int getNumBodies() const override { return definitions->getNumRigidBodies(); }
    std::vector<OpenMM::Vec3> getBodyPositions(OpenMM::ContextImpl& context) override;
    std::vector<QuaternionArray> getBodyOrientations(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> getBodyVelocities(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> getBodyAngularVelocities(OpenMM::ContextImpl& context) override;
    void setBodyPositions(OpenMM::ContextImpl& context, const std::vector<OpenMM::Vec3>& positions) override;
    void setBodyOrientations(OpenMM::ContextImpl& context, const std::vector<QuaternionArray>& orientations) override;
    void setBodyVelocities(OpenMM::ContextImpl& context, const std::vector<OpenMM::Vec3>& velocities) override;
    void setBodyAngularVelocities(OpenMM::ContextImpl& context,
                                  const std::vector<OpenMM::Vec3>& angularVelocities) override;
    std::vector<OpenMM::Vec3> getBodyForces(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> getBodyTorques(OpenMM::ContextImpl& context) override;
    double getPoseResidual(OpenMM::ContextImpl& context) override;
    double computeTranslationalKineticEnergy(OpenMM::ContextImpl& context) override;
    OpenMM::Vec3 computeRotationalKineticEnergies(OpenMM::ContextImpl& context) override;
    double computeFreeParticleKineticEnergy(OpenMM::ContextImpl& context) override;
    std::map<std::string, int> getDegreesOfFreedom(OpenMM::ContextImpl& context) override;
    std::map<std::string, std::string> getEffects(OpenMM::ContextImpl& context) override;
    std::string describeEffects(OpenMM::ContextImpl& context) override;
    std::map<std::string, double> getStepStatistics(OpenMM::ContextImpl& context) override;
    std::vector<OpenMM::Vec3> drawVelocities(OpenMM::ContextImpl& context, double temperature, int seed) override;
    void updateFluid(OpenMM::ContextImpl& context, const MobilityForce& force) override;
    std::vector<double> getMobility(OpenMM::ContextImpl& context) override;
    std::vector<double> getFriction(OpenMM::ContextImpl& context) override;
    std::vector<double> applyMobility(OpenMM::ContextImpl& context, const std::vector<double>& wrenches) override;
    std::vector<double> applyBlobMobility(OpenMM::ContextImpl& context, const std::vector<double>& forces) override;
    int getNumRejectedSteps(OpenMM::ContextImpl& context) override;
    void createCheckpoint(OpenMM::ContextImpl& context, std::ostream& stream) override;
    void loadCheckpoint(OpenMM::ContextImpl& context, std::istream& stream) override;
    void serialize(OpenMM::ContextImpl& context, OpenMM::SerializationNode& node) override;
    void deserialize(OpenMM::ContextImpl& context, const OpenMM::SerializationNode& node) override;

protected:
    /** The platform's loops; called once, from initialize(). */
    virtual std::unique_ptr<PlatformLoops> createLoops(OpenMM::ContextImpl& context) = 0;

private:
    SavedState collectState(OpenMM::ContextImpl& context);
    void adoptState(const SavedState& saved);
    void checkAgainstDefinition(int body, const BodyGeometry& saved) const;
    void checkPosesAgainstPositions(const SavedState& saved);

    std::vector<OpenMM::Vec3>& positions() { return *data.positions; }
    std::vector<OpenMM::Vec3>& velocities() { return *data.velocities; }
    ParticleArrays arrays();
    LoopResult runLoop(BodyLoop loop);

    /** Seconds since an arbitrary point. */
    static double now();
    void updateSettings();
    void printWarnings();
    /** What the user should know about the settings. A cause is told once, though its numbers may change from step to step. */
    enum class WarningCause { OmittedDrift, UnresolvedRotation, LargeFriction };
    std::map<WarningCause, std::string> warnings() const;
    void recordGeometry(int body, const BodyGeometry& geometry);
    void buildBodies(const std::vector<BodyGeometry>& newGeometries);
    void deriveGeometries();
    void takeInChanges(OpenMM::ContextImpl& context, bool stepping = false);
    void takeInPositions();
    void takeInVelocities(bool putBack);
    void takeInVelocitiesIfChanged(OpenMM::ContextImpl& context);
    void takeInTwist(int body);
    void requirePositions(const char* what) const;
    void putMembersBack(OpenMM::ContextImpl& context);
    bool massesAreTheSystems() const;
    bool momentumIsOursToRemove() const;
    void undoRemovalFromParticles();
    void removeMomentum();
    void writePoses(OpenMM::ContextImpl& context);
    void placeFreeVirtualSites(OpenMM::ContextImpl& context);
    void rememberOtherParticles();
    void evaluateForces(OpenMM::ContextImpl& context);
    void calculateForces(OpenMM::ContextImpl& context);
    void addBodyForces(OpenMM::ContextImpl& context, double time, double lookAhead);
    void advance(OpenMM::ContextImpl& context);
    std::string attemptStep(OpenMM::ContextImpl& context);
    void takeOverdampedStep(OpenMM::ContextImpl& context);
    void runStage(int stage);
    void scatterOverdamped(OpenMM::ContextImpl& context);
    std::string objectionHalfAStepAhead(OpenMM::ContextImpl& context, double tolerance);
    void reportTooManyRejections(const std::string& objection, int attempts);
    LoopResult moveThroughFluid(double tolerance);
    std::unique_ptr<Fluid> makeFluid(const std::vector<BodyGeometry>& ofBodies, const BodySet& arrays);
    std::vector<std::vector<int> > particlesOfBodies() const;
    void checkFluid(const MobilityForce& force) const;
    void rebuildFluid();
    void adoptWallRejection();
    Fluid& requireFluid(OpenMM::ContextImpl& context, const char* method);
    [[noreturn]] void reportNonFinite(const char* what);
    bool bodyMembersDiffer(int body, const std::vector<OpenMM::Vec3>& a, const std::vector<OpenMM::Vec3>& b) const;

    OpenMM::ReferencePlatform::PlatformData& data;
    const CustomRigidHIIntegrator* integrator = nullptr;
    const OpenMM::System* system = nullptr;
    // The bodies as they were when the Context was created: what users add or redefine later takes effect at the next
    // one.
    std::unique_ptr<CustomRigidHIIntegrator> definitions;
    std::unique_ptr<PlatformLoops> loops;
    SystemInventory stock;
    std::unique_ptr<ConstraintsOfParticles> constraints;
    BodySet bodies;
    std::vector<BodyGeometry> geometries;  // of the bodies whose geometry is known
    std::vector<PoseFit> fits;
    std::unique_ptr<FreeParticles> freeParticles;
    // The fluid, if there is a MobilityForce; a copy of the latter as the user handed it over last.
    std::unique_ptr<MobilityForce> fluidParameters;
    std::unique_ptr<Fluid> fluid;
    BodyForces bodyForces;
    ForceChoice forceChoice;
    double bodyForcesTime = 0;  // of the forces that the bodies have
    StepSettings settings;
    int settingsVersion = -1;
    double settingsStepSize = 0;
    std::set<WarningCause> printedWarnings;
    bool positionsAreSet = false, bodiesAreBuilt = false, forcesAreValid = false, membersNeedPuttingBack = false;
    bool velocitiesNeedPuttingBack = false;
    bool userChangedState = false;
    double poseResidual = 0;
    uint32_t seed = 1;
    int64_t stepNumber = 0;

    // What this kernel wrote to the Context last, to notice what others did.
    std::vector<OpenMM::Vec3> lastPositions, lastVelocities;
    std::vector<OpenMM::Vec3> velocitiesBeforeRemoval;  // where momentumIsOursToRemove()
    OpenMM::Vec3 lastBox[3];
    // After loading a state: compare by hash instead, once; but fit bodies whose definition is another than the saved one.
    bool compareByHash = false;
    std::unique_ptr<SavedState> loaded;
    std::vector<int> bodiesOfOtherDefinition;
    // Twists drawn by drawVelocities(), for the setVelocities() that follows.
    std::vector<BodyState> drawnTwists;
    std::vector<OpenMM::Vec3> drawnVelocities;

    BodySet::Snapshot bodySnapshot, aheadBodies;
    FreeParticles::Snapshot freeSnapshot, aheadFree;
    // Plain numbers: a step must not allocate (getStepStatistics() gives them names).
    struct Counters {
        long long steps = 0, forceEvaluations = 0, randomNumbers = 0, rejectedSteps = 0;
        double seconds_forces = 0, seconds_mobility = 0, seconds_scheme = 0;
    } counters;
};

}  // namespace RigidHIPlugin

#endif
