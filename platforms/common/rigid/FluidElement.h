#ifndef RIGIDHI_FLUID_ELEMENT_H_
#define RIGIDHI_FLUID_ELEMENT_H_

#include <Eigen/Core>
#include <vector>

#include "mobility/MobilityModel.h"
#include "rigid/SlowedSpin.h"

namespace RigidHIPlugin {

/** A body, or a free particle, as the fluid sees it. */
struct FluidElement {
    int body = -1;               // index of the body, -1: a free particle
    std::vector<int> particles;  // hydrodynamic particles, indices in the System
    std::vector<Eigen::Vector3d>
        sites;                    // their places in the body frame, nm from the body's origin
    std::vector<double> radii;    // nm
    Eigen::MatrixXd ownMobility;  // 6 x 6, body frame, or empty: setBodyMobility()
    SlowedSpin spin;              // slowed in the step at hand

    bool isFree() const { return body < 0; }
    /** One hydrodynamic particle takes force and torque. Those of a multiblob take forces only. */
    bool isSphere() const { return !isFree() && particles.size() == 1; }
    int numRows() const { return isFree() ? 3 : 6; }
    /**
     * Whether K stands for K' of SlowedSpin. Own tensors are slowed themselves, and K stays. A
     * sphere has no fastest axis.
     */
    bool slowsK() const { return spin.isSlowed() && ownMobility.size() == 0; }
    int numParticleRows() const { return (isSphere() ? 6 : 3) * particles.size(); }
};

/** The hydrodynamic particles of elements, in their order. */
HydrodynamicParticles particlesOf(const std::vector<FluidElement>& elements);
/** The positions of one element's particles in the element's own frame. */
std::vector<OpenMM::Vec3> sitesOf(const FluidElement& element);

}  // namespace RigidHIPlugin

#endif
