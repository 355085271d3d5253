#ifndef RIGIDHI_FLUID_GROUP_H_
#define RIGIDHI_FLUID_GROUP_H_

#include <memory>
#include <string>
#include <vector>

#include "fluid/Relaxation.h"
#include "rigid/BodyMobilities.h"
#include "schemes/OverdampedSchemes.h"

namespace RigidHIPlugin {

/**
 * The last step of a group without momenta. Users who ask for the flow of the fluid in this step
 * have it done again from these data.
 */
struct LastStep {
    bool isKnown = false;
    CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::EulerMaruyama;
    OverdampedStep step;
    BoxVectors box = {};
    std::vector<Pose> start, end;
    std::vector<Eigen::MatrixXd> forces;  // of each stage; empty: the stage has none
    std::vector<Eigen::MatrixXd> memory;  // of the scheme, at the start of the step
};

/**
 * The data of a group for a scheme without momenta, and the progress of the group in the present
 * step.
 */
struct OverdampedProgress {
    BodyMobility* mobility = nullptr;      // of the step: the real one, or that of slowed spins
    BodyMobility* realMobility = nullptr;  // with the real spins
    std::unique_ptr<OverdampedMove> move;  // made at the first step without momenta
    std::unique_ptr<OverdampedScheme> scheme;
    std::vector<Eigen::MatrixXd> memoryAtStart;
    LastStep present, last;  // what is recorded of the present step; the last whole step
    int stage = 0;           // stages of the present step that are done
    uint32_t attempt = 0;    // of the present step
    std::string objection;   // against the poses after the last stage
    bool isFinite = true;    // whether these poses are finite
    std::vector<std::vector<Pose>> placesOfForces;  // where those of each stage are evaluated
    long long squareRoots = 0, iterations = 0, randomNumbers = 0;  // of the last stage
};

/** The bodies of a group with slowed spins, for schemes without momenta. */
struct SlowedBodies {
    SlowedBodies(const CoupledBodies& real, const std::vector<SlowedSpin>& spins, double tolerance)
        : bodies(real, spins), mobilities(bodies, tolerance) {}
    CoupledBodies bodies;
    BodyMobilities mobilities;
};

/**
 * How forces have turned a slowed body about its fastest axis, beside what noise does. Where forces
 * have a potential, the two are of one size, since the body goes nowhere (THEORY.md).
 */
struct DrivenSpin {
    double turn = 0, variance = 0;  // rad, rad^2
    long long steps = 0;
};

/**
 * Elements that feel each other: the bodies of a replica, or one body under FreeDraining. The group
 * has the best strategy for each of three purposes (GroupBuilder). The strategies may be the same.
 */
struct FluidGroup {
    FluidGroup(const std::vector<FluidElement>& elements,
               const CoupledBodies::ModelFactory& makeModel, double tolerance)
        : bodies(elements, makeModel), mobilities(bodies, tolerance), poses(elements.size()) {}

    CoupledBodies bodies;
    BodyMobilities mobilities;
    std::unique_ptr<SlowedBodies> slowed;  // made when first needed
    std::vector<int> freeIndex;            // of each element in FreeParticles, -1: a body
    bool hasNullVectors = false;
    bool isThermostat = false;  // its tensor is a Thermostat, so that LangevinHI has nothing to do
    double drag_t = 0, drag_r[3] = {0, 0, 0};  // if it is a thermostat
    std::unique_ptr<Relaxation> relaxation;    // for LangevinHI; null if it is a thermostat
    std::vector<std::shared_ptr<const CoupledBodies::Alone>>
        alone;                            // of the elements; empty: not asked for yet
    std::vector<BodyRotation> rotations;  // of the elements, in steps of this energy
    double doubleEnergy = -1;             // 2 kT h of `rotations`
    double energyOfMobility = -1;         // 2 kT h that overdamped.mobility was chosen for
    double slowedEnergy = -1;             // 2 kT h that `slowed` was made for
    std::vector<DrivenSpin> drivenSpins;  // of the elements
    MobilityCosts costsOfFormerSlowed;
    OverdampedProgress overdamped;      // for schemes without momenta
    BodyMobility* answering = nullptr;  // for requests of users
    std::vector<Pose> poses;
    std::string gridChoice;        // how Auto chose between matrices and a grid; empty: it did not
    bool dependsOnScheme = false;  // whether it would choose anew for another scheme

    /** Read the poses of the elements. */
    void readPoses(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions,
                   std::vector<Pose>& to) const;
    const std::vector<Pose>& readPoses(const BodySet& bodies,
                                       const std::vector<OpenMM::Vec3>& positions) {
        readPoses(bodies, positions, poses);
        return poses;
    }
};

}  // namespace RigidHIPlugin

#endif
