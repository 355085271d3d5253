#ifndef RIGIDHI_USER_FLOW_H_
#define RIGIDHI_USER_FLOW_H_

#include <openmm/Vec3.h>

#include <vector>

#include "mobility/DrivenFlow.h"
#include "mobility/MobilityAt.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/** The flow that users drive, as a MobilityForce describes it, without a box. */
struct UserFlow {
    explicit UserFlow(const MobilityForce& force);
    bool hasWave() const { return f0 != 0; }
    bool hasBackground() const;
    bool isAny() const { return hasWave() || hasBackground(); }
    /** @throws OpenMMException if the boundary has no such flow */
    void check() const;
    /** The flow in a box; without its wave where there is no box yet. */
    DrivenFlow inBox(const BoxVectors& box) const;

    double f0;
    int forceAxis, waveAxis, waveVectorIndex;
    OpenMM::Vec3 velocity;
    std::vector<double> gradient;

private:
    const bool isFreeDraining;
    const MobilityForce::Boundary boundary;
    const double viscosity, wallHeight;
};

}  // namespace RigidHIPlugin

#endif
