#ifndef RIGIDHI_NO_SLIP_PLANE_H_
#define RIGIDHI_NO_SLIP_PLANE_H_

#include <openmm/Vec3.h>

#include <string>
#include <vector>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * A no-slip plane z = height with the fluid above it, and the positions that it allows.
 *
 * Where the surface of a particle reaches through the wall, the formulas for its mobility do not
 * hold. Without crossing the plane refuses such positions, except for rounding, which counts as
 * touching. With crossing allowed, every particle of radius a with its centre at 0 < z < a above
 * the wall counts as touching it, and the factor z/a multiplies its velocities and forces, and also
 * its angular velocities and torques: M -> B M B, B = diag(min(1, z/a)), with M at max(z, a). This
 * mobility is continuous, and the matrix stays symmetric positive definite. The plane always
 * refuses centres on or behind the wall.
 */
class NoSlipPlane {
public:
    /**
     * @param height           z of the wall, nm
     * @param crossingAllowed  whether surfaces of particles may reach through the wall
     * @throws OpenMMException if the height is not finite
     */
    NoSlipPlane(double height, bool crossingAllowed);
    /**
     * The reason why a position is not allowed, with the name of the first such particle; empty if
     * all positions are allowed.
     */
    std::string objection(const HydrodynamicParticles& particles,
                          const std::vector<OpenMM::Vec3>& positions) const;
    /** The height above the wall at which the formulas are evaluated, at least the radius. */
    double heightOver(double z, double radius) const;
    /** A particle lifted to contact, if its surface reaches through the wall. */
    OpenMM::Vec3 placeInFormulas(const OpenMM::Vec3& position, double radius) const {
        return OpenMM::Vec3(position[0], position[1], height + heightOver(position[2], radius));
    }
    /** A particle's entry of B. */
    double weight(double z, double radius) const;
    double getHeight() const { return height; }
    /**
     * Whether the formulas hold a little below contact, too, as finite differences need. Where
     * velocities are damped they do not.
     */
    bool reachesBeyond() const { return !crossingAllowed; }
    bool acceptsNearby(const HydrodynamicParticles& particles,
                       const std::vector<OpenMM::Vec3>& positions) const;

private:
    const double height;
    const bool crossingAllowed;
};

/** The text for a particle in a message: its index in the System and its body. */
std::string particleAndBody(const HydrodynamicParticles& particles, int i);

}  // namespace RigidHIPlugin

#endif
