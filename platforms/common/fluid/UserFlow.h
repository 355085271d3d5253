#ifndef RIGIDHI_USER_FLOW_H_
#define RIGIDHI_USER_FLOW_H_

#include <openmm/Vec3.h>

#include <vector>

#include "mobility/DrivenFlow.h"
#include "mobility/MobilityAt.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/** The flow that users drive, as a MobilityForce describes it, independent of the box. */
struct UserFlow {
    explicit UserFlow(const MobilityForce& force);
    bool hasWave() const { return f0 != 0; }
    bool hasBackground() const;
    /** Whether a moving wall or a uniform force density drives the flow. */
    bool isAlongPlanes() const;
    /** Whether the periodic box tilts with the flow. */
    bool isSheared() const { return shearRate != 0; }
    bool isAny() const { return hasWave() || hasBackground() || isAlongPlanes() || isSheared(); }
    /**
     * The box after it has moved with the shear for `time`, ps, in OpenMM's reduced form: multiples
     * of shorter vectors change each vector until it tilts by at most half of them.
     */
    BoxVectors tilted(BoxVectors box, double time) const;
    /** @throws OpenMMException if the boundary has no such flow */
    void check() const;
    /** The flow in a box; without its wave before the box is known. */
    DrivenFlow inBox(const BoxVectors& box) const;
    /**
     * The flow that a uniform force density of 1 along x or y drives between the planes of the
     * fluid; none if its mean is 0.
     */
    DrivenFlow ofUnitForceDensity(int axis) const;
    /** Whether the fluid has no-slip planes and periods along them alone. */
    bool hasPlanes() const;
    /**
     * Give a flow the no-slip planes of the fluid, if the fluid has such planes in a periodic box.
     */
    void setPlanes(DrivenFlow& flow) const;

    double f0;
    int forceAxis, waveAxis, waveVectorIndex;
    double shearRate;
    int flowAxis, gradientAxis;
    OpenMM::Vec3 velocity, wallVelocity, bodyForceDensity;
    std::vector<double> gradient;
    double low, high;  // walls, nm; infinite without walls

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
