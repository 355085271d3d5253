#ifndef OPENMMRIGIDHI_FLUID_IN_CONTEXT_H_
#define OPENMMRIGIDHI_FLUID_IN_CONTEXT_H_

#include <openmm/Vec3.h>

#include <vector>

#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * What users ask a MobilityForce about the fluid of a Context. Each method answers the
 * MobilityForce's method of the same name with "InContext", which documents it; the MobilityForce
 * has checked the arguments.
 */
class FluidInContext {
public:
    virtual ~FluidInContext() {}

    /** Take over the parameters of the MobilityForce. */
    virtual void updateParameters(const MobilityForce& force) = 0;
    /** The numbers of a matrix, row after row. */
    virtual std::vector<double> getMobility() = 0;
    virtual std::vector<double> getFriction() = 0;
    virtual std::vector<double> applyMobility(const std::vector<double>& wrenches) = 0;
    virtual std::vector<double> applyBlobMobility(const std::vector<double>& forces) = 0;
    virtual std::vector<OpenMM::Vec3> getFlow(const std::vector<OpenMM::Vec3>& points) = 0;
    virtual std::vector<double> getFlowMode(int forceAxis, int waveAxis, int waveVectorIndex) = 0;
    virtual std::vector<double> getRandomFlowMode(int forceAxis, int waveAxis,
                                                  int waveVectorIndex) = 0;
    virtual OpenMM::Vec3 getMeanFlow() = 0;
    virtual OpenMM::Vec3 getRandomMeanFlow() = 0;
    virtual std::vector<double> getStress() = 0;
};

}  // namespace RigidHIPlugin

#endif
