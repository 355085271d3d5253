#ifndef RIGIDHI_NO_SLIP_PLANE_H_
#define RIGIDHI_NO_SLIP_PLANE_H_

#include <openmm/Vec3.h>

#include <string>
#include <vector>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * A no-slip plane z = height with the fluid above it, and where particles may be.
 *
 * Where the surface of a particle reaches through the wall the formulas for its mobility do not
 * hold. Such positions are refused (but for rounding, which counts as touching), or, with crossing
 * allowed, every particle of radius a with its centre at 0 < z < a over the wall counts as touching
 * it, and its velocities and its forces (and what belongs to rotation) are multiplied by z/a: M ->
 * B M B, B = diag(min(1, z/a)), M at max(z, a). That is continuous and keeps the matrix symmetric
 * positive definite. Centres on the wall or behind are refused.
 */
class NoSlipPlane {
public:
    /**
     * @param height           z of the wall, nm
     * @param crossingAllowed  whether surfaces of particles may reach through the wall
     * @throws OpenMMException if the height is not finite
     */
    NoSlipPlane(double height, bool crossingAllowed);
    /** Why a particle may not be where it is, naming the first; empty if all may. */
    std::string objection(const HydrodynamicParticles& particles,
                          const std::vector<OpenMM::Vec3>& positions) const;
    /** The height over the wall at which formulas hold, at least the radius. */
    double heightOver(double z, double radius) const;
    /** A particle lifted to contact, if its surface reaches through the wall. */
    OpenMM::Vec3 placeInFormulas(const OpenMM::Vec3& position, double radius) const {
        return OpenMM::Vec3(position[0], position[1], height + heightOver(position[2], radius));
    }
    /** A particle's entry of B. */
    double weight(double z, double radius) const;
    double getHeight() const { return height; }
    /** Whether formulas hold a little below contact too, as finite differences from there need it:
     * not where velocities are damped. */
    bool reachesBeyond() const { return !crossingAllowed; }
    bool acceptsNearby(const HydrodynamicParticles& particles,
                       const std::vector<OpenMM::Vec3>& positions) const;

private:
    const double height;
    const bool crossingAllowed;
};

/** A particle in a message: index in the System and body. */
std::string particleAndBody(const HydrodynamicParticles& particles, int i);

}  // namespace RigidHIPlugin

#endif
