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
    /** Whether there is the flow of a moving wall, or that of a uniform force density. */
    bool isAlongPlanes() const;
    /** Whether the periodic box tilts with the flow. */
    bool isSheared() const { return shearRate != 0; }
    bool isAny() const { return hasWave() || hasBackground() || isAlongPlanes() || isSheared(); }
    /**
     * The box that has moved with the shear for so long, ps, in OpenMM's form: each vector changes
     * by shorter ones until it tilts by half of them at most.
     */
    BoxVectors tilted(BoxVectors box, double time) const;
    /** @throws OpenMMException if the boundary has no such flow */
    void check() const;
    /** The flow in a box; without its wave where there is no box yet. */
    DrivenFlow inBox(const BoxVectors& box) const;
    /**
     * The flow that a uniform force density 1 along x or y drives between the planes of the fluid;
     * none where its mean is 0.
     */
    DrivenFlow ofUnitForceDensity(int axis) const;
    /** Whether the fluid has no-slip planes and periods along them alone. */
    bool hasPlanes() const;
    /** Give a flow the no-slip planes of the fluid, if it has some in a periodic box. */
    void setPlanes(DrivenFlow& flow) const;

    double f0;
    int forceAxis, waveAxis, waveVectorIndex;
    double shearRate;
    int flowAxis, gradientAxis;
    OpenMM::Vec3 velocity, wallVelocity, bodyForceDensity;
    std::vector<double> gradient;
    double low, high;  // walls, nm; infinite where there are none

private:
    void checkBackground() const;
    void checkAlongPlanes() const;
    void checkShear() const;

    const bool isFreeDraining, hasZeroFlux;
    const MobilityForce::Boundary boundary;
    const double viscosity;
};

}  // namespace RigidHIPlugin

#endif
