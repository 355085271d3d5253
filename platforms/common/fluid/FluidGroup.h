#ifndef RIGIDHI_FLUID_GROUP_H_
#define RIGIDHI_FLUID_GROUP_H_

#include <memory>
#include <string>
#include <vector>

#include "fluid/Relaxation.h"
#include "rigid/BodyMobilities.h"
#include "schemes/OverdampedSchemes.h"

namespace RigidHIPlugin {

/** The last step of a group without momenta: what it can be done again from, by those who ask for
 * the flow of the fluid in it. */
struct LastStep {
    bool isKnown = false;
    OverdampedStep step;
    BoxVectors box = {};
    std::vector<Pose> start, end;
    std::vector<Eigen::MatrixXd> forces;  // of each stage; empty: it has none
    std::vector<Eigen::MatrixXd> memory;  // of the scheme, at its start
};

/** What a scheme without momenta needs of a group, and how far it is in the present step. */
struct OverdampedProgress {
    BodyMobility* mobility = nullptr;
    std::unique_ptr<OverdampedMove> move;  // made at the first step without momenta
    std::unique_ptr<OverdampedScheme> scheme;
    std::vector<Eigen::MatrixXd> memoryAtStart;
    LastStep last;
    int stage = 0;                                  // stages of the present step that are done
    uint32_t attempt = 0;                           // of the present step
    std::string objection;                          // to where the last part led
    bool isFinite = true;                           // where it led
    std::vector<std::vector<Pose>> placesOfForces;  // where those of each stage are evaluated
    long long squareRoots = 0, iterations = 0, randomNumbers = 0;  // of the last part
};

/**
 * What feels each other: the bodies of a replica, or one body under FreeDraining. For each of three
 * purposes it has the strategy that is best (GroupBuilder); they may be the same.
 */
struct FluidGroup {
    FluidGroup(const std::vector<FluidElement>& elements,
               const CoupledBodies::ModelFactory& makeModel, double tolerance)
        : bodies(elements, makeModel), mobilities(bodies, tolerance), poses(elements.size()) {}

    CoupledBodies bodies;
    BodyMobilities mobilities;
    std::vector<int> freeIndex;  // of each element in FreeParticles, -1: a body
    bool hasNullVectors = false;
    bool isThermostat = false;  // its tensor is a Thermostat: nothing is to be done by LangevinHI
    double drag_t = 0, drag_r[3] = {0, 0, 0};  // then
    std::unique_ptr<Relaxation> relaxation;    // LangevinHI; none if it is a thermostat
    OverdampedProgress overdamped;             // schemes without momenta
    BodyMobility* answering = nullptr;         // what users ask for
    std::vector<Pose> poses;

    /** Where its elements are. */
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
