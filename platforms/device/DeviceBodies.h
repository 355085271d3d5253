#ifndef RIGIDHI_DEVICE_BODIES_H_
#define RIGIDHI_DEVICE_BODIES_H_

#include <openmm/Vec3.h>
#include <openmm/common/ComputeArray.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "Device.h"
#include "context/Scene.h"
#include "host/MidStep.h"
#include "text/SchemeText.h"

namespace RigidHIPlugin {

/**
 * The bodies and free particles of a scene in the memory of a device, and the kernels that move
 * them (kernels/bodies.cc). The state is always in double precision; particles have the precision
 * of the platform.
 *
 * Poses are those of the Context's positions, without images. For each particle the class keeps the
 * lattice vector from this position to the image that the platform uses.
 */
class DeviceBodies {
public:
    explicit DeviceBodies(std::unique_ptr<const Device> device);
    ~DeviceBodies();

    /**
     * Take over the shapes, factors and states of a scene, which must have adopted its settings.
     *
     * @throws OpenMMException  if the device cannot; these bodies are then of no use any more
     */
    void upload(const Scene& scene);
    /** Give the states to the scene: bodies, free particles, and their forces. */
    void download(Scene& scene) { giveTo(scene, state); }
    /** Whether a scene has anything to move. */
    static bool hasBodies(const Scene& scene);

    /** Save the states; and give the scene the states that were saved last. */
    void save();
    void downloadSaved(Scene& scene) { giveTo(scene, savedState); }

    /** After OpenMM has sorted the particles, find their places and images again. */
    void particlesWereSorted();
    /**
     * After a barostat has moved particles, move whole bodies with them, within their present
     * images. OpenMM forgets these images at some moves, so this method tells it again.
     * @param kept  whether positions are as before, except for lattice vectors
     */
    void particlesWereMoved(bool kept);
    /** Whether positions of particles agree with the poses. This call waits for the device. */
    bool agreeWithParticles();
    /** Take in velocities of free particles, which others may have changed. */
    void takeInVelocities();
    /** Write positions of all particles from the poses. */
    void writePositions();

    /**
     * @param removesMomentum  whether to remove the total momentum first. OpenMM's CMMotionRemover
     *     sums up in single precision, so its changes of the particles are ignored.
     */
    void beforeForces(const StepSettings& settings, bool removesMomentum);
    void afterForces(const StepSettings& settings, bool onlyGathers = false);
    /**
     * Whether a number was not finite, or the device cannot do a step. From then on kernels do
     * nothing. This call waits for the device.
     */
    bool isStopped();
    /** Whether the last answer of isStopped() was due to a number that is not finite. */
    bool foundNonFinite() const { return nonFinite; }
    void restart();
    /** midStepEnergiesOfMeans() of the bodies. This call waits for the device. */
    MidStepEnergies midStepEnergies();

    /**
     * Say that some Force acts differently on periodic images, so that particles must not stay in
     * the images to which OpenMM moves them when it sorts. All particles without mass must be in
     * bodies that move, or virtual sites.
     */
    void keepOutOfImages() { seesImages = true; }
    /** Set the tolerance of constraints between free particles. */
    void setConstraintTolerance(double tolerance) { constraintTolerance = tolerance; }

    /** The number of random numbers in a step. */
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
    void leaveImages();
    void setStep(Kernel& kernel, const StepSettings& settings);
    class ConstrainedFlow;
    const std::unique_ptr<const Device> device;
    OpenMM::ComputeContext& cc;
    SortListener* listener;  // the context owns it
    long long shapesVersion = -1, randomNumbers = 0;
    NativeSteps::Counts counts;
    bool nonFinite = false;  // the last answer of isStopped() was due to such a number
    int bodySlots = 0, slots = 0;
    bool isPeriodic = false, hasNoise = false, isConstrained = false, hasMomenta = false;
    bool seesImages = false;
    double rounding = 0, longestEdge = 0, totalMass = 0, constraintTolerance = 0;
    OpenMM::ComputeArray state, savedState, factors, means, blocks, noiseIndex, sites, siteParticle,
        forceParticle, images, placeOf, sitePlace, forcePlace, flags, sums, momentumPart, momentum;
    std::vector<int> siteParticles;
    std::vector<std::pair<int, int>> freeVirtualSites;  // each with one of its parents
    std::string compiled;  // source and definitions of the present kernels
    std::unique_ptr<Kernel> findPlacesKernel, findPlacesOfSitesKernel, takeInKernel, beforeKernel,
        afterKernel, energiesKernel, writeKernel, sumMomentaKernel, addMomentaKernel,
        moveFreeKernel, endDriftKernel, takeInFreeKernel, writeVelocitiesKernel;
};

}  // namespace RigidHIPlugin

#endif
