#ifndef RIGIDHI_FLUID_ELEMENT_H_
#define RIGIDHI_FLUID_ELEMENT_H_

#include <Eigen/Core>
#include <vector>

#include "mobility/MobilityModel.h"
#include "rigid/SlowedSpin.h"

namespace RigidHIPlugin {

/** A force of MobilityForce::addBodyForceOnFluid(), in the body frame. */
struct ForceOnFluid {
    Eigen::Vector3d site;  // nm from the body's origin
    double radius;
    Eigen::Vector3d force;
};

/** A body, or a free particle, as the fluid sees it. */
struct FluidElement {
    int body = -1;               // index of the body, -1: a free particle
    std::vector<int> particles;  // hydrodynamic particles, indices in the System
    std::vector<Eigen::Vector3d>
        sites;                    // their places in the body frame, nm from the body's origin
    std::vector<double> radii;    // nm
    Eigen::MatrixXd ownMobility;  // 6 x 6, body frame, or empty: setBodyMobility()
    SlowedSpin spin;              // slowed in the step at hand
    std::vector<Eigen::Vector3d>
        slips;  // setBodySlip(): of the particles, in the body frame, nm/ps, or empty
    std::vector<ForceOnFluid> forcesOnFluid;
    /**
     * The components of the twist that are fixed, at rest or prescribed: a bit for each of Vx, Vy,
     * Vz, Wx, Wy, Wz, in the lab frame, or along `axes` if `fixedInBody`.
     */
    unsigned fixed = 0;
    bool fixedInBody = false;
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // columns, in the body frame
    bool isHeld = false;  // it never moves: all components are fixed, at rest

    void hold() {
        isHeld = true;
        fixed = (1u << numRows()) - 1;
    }
    bool isFixed(int component) const { return fixed >> component & 1; }
    bool isWhollyFixed() const { return fixed == (1u << numRows()) - 1; }
    bool isWhollyFree() const { return fixed == 0; }
    bool isFree() const { return body < 0; }
    /**
     * Whether the body is one hydrodynamic particle, which takes force and torque. The particles of
     * a multiblob take forces only.
     */
    bool isSphere() const { return !isFree() && particles.size() == 1; }
    int numRows() const { return isFree() ? 3 : 6; }
    /**
     * Whether K stands for K' of SlowedSpin. An own tensor is slowed itself, and K stays. A sphere
     * has no fastest axis.
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
