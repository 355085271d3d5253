#ifndef RIGIDHI_DEVICE_BODIES_H_
#define RIGIDHI_DEVICE_BODIES_H_

#include <openmm/Vec3.h>
#include <openmm/common/ComputeArray.h>
#include <openmm/common/ComputeContext.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "context/Scene.h"
#include "host/MidStep.h"
#include "text/SchemeText.h"

namespace RigidHIPlugin {

/**
 * The bodies and free particles of a scene in the memory of a device, and the kernels that move
 * them (kernels/bodies.cc). State is in double precision always; particles have the platform's.
 *
 * Poses are those of the Context's positions, without images. The lattice vector from there to the
 * image that the platform keeps of a particle is kept for each particle.
 */
class DeviceBodies {
public:
    explicit DeviceBodies(OpenMM::ComputeContext& cc);
    ~DeviceBodies();

    /** Take over the shapes, factors and states of a scene; its settings must be adopted. */
    void upload(const Scene& scene);
    /** Give the states to the scene: bodies, free particles, and their forces. */
    void download(Scene& scene) { giveTo(scene, state); }
    /** Whether a scene has anything to move. */
    static bool hasBodies(const Scene& scene);

    /** Keep the states, and give the scene those that were kept last. */
    void save();
    void downloadSaved(Scene& scene) { giveTo(scene, savedState); }

    /** OpenMM may have sorted the particles. Find where they are, and in which images. */
    void particlesWereSorted();
    /**
     * A barostat has moved particles: take whole bodies along, within the images that they are in.
     * OpenMM forgets these images at some moves; it is told them again.
     * @param kept  whether positions are as before, but for lattice vectors
     */
    void particlesWereMoved(bool kept);
    /** Whether positions of particles are those of the poses. This call waits for the device. */
    bool agreeWithParticles();
    /** Others may have changed velocities of free particles. */
    void takeInVelocities();
    /** Write positions of all particles from the poses. */
    void writePositions();

    /**
     * @param removesMomentum  whether the momentum of all is to become 0 first. OpenMM's
     *     CMMotionRemover adds up in single precision, so what it did to the particles is ignored.
     */
    void beforeForces(const StepSettings& settings, bool removesMomentum);
    void afterForces(const StepSettings& settings, bool onlyGathers = false);
    /**
     * Whether a number was not finite, or something is not to be done here. Kernels do nothing from
     * then on. This call waits for the device.
     */
    bool isStopped();
    void restart();
    /** midStepEnergiesOfMeans() of the bodies. This call waits for the device. */
    MidStepEnergies midStepEnergies();

    /** Of constraints between free particles. */
    void setConstraintTolerance(double tolerance) { constraintTolerance = tolerance; }

    /** The random numbers of a step. */
    long long getRandomNumbers() const { return randomNumbers; }
    const NativeSteps::Counts& getCounts() const { return counts; }

private:
    class Kernel;
    class SortListener;
    void makeShapes(const Scene& scene);
    void makeFactors(const Scene& scene);
    void compile(const Scene& scene);
    void giveTo(Scene& scene, OpenMM::ComputeArray& from);
    void setBox();
    void findPlaces();
    void compareWithParticles(bool moves = false);
    void giveImages();
    void setStep(Kernel& kernel, const StepSettings& settings);
    class ConstrainedFlow;
    OpenMM::ComputeContext& cc;
    SortListener* listener;  // the context owns it
    long long shapesVersion = -1, randomNumbers = 0;
    NativeSteps::Counts counts;
    int bodySlots = 0, slots = 0;
    bool isPeriodic = false, hasNoise = false, isConstrained = false, hasMomenta = false;
    double rounding = 0, longestEdge = 0, totalMass = 0, constraintTolerance = 0;
    OpenMM::ComputeArray state, savedState, factors, means, blocks, noiseIndex, sites, siteParticle,
        forceParticle, images, placeOf, flags, sums, momentumPart, momentum;
    std::vector<int> siteParticles;
    std::vector<std::pair<int, int>> freeVirtualSites;  // and a parent of each
    std::string compiled;  // source and definitions of the present kernels
    std::unique_ptr<Kernel> findPlacesKernel, takeInKernel, beforeKernel, afterKernel,
        energiesKernel, writeKernel, sumMomentaKernel, addMomentaKernel, moveFreeKernel,
        endDriftKernel, takeInFreeKernel;
};

}  // namespace RigidHIPlugin

#endif
