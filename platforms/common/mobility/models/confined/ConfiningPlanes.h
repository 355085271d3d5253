#ifndef RIGIDHI_CONFINING_PLANES_H_
#define RIGIDHI_CONFINING_PLANES_H_

#include <openmm/Vec3.h>

#include <string>

#include "mobility/MobilityModel.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * The planes z = const that bound a fluid periodic along x and y (PeriodicWall, NoSlipChannel or
 * Film), and the positions that they allow.
 *
 * Without crossing, surfaces of particles end at the planes, except for rounding, which counts as
 * touching. With crossing allowed, only centres must be within the fluid. The model decides how to
 * treat particles that reach through a plane: RotnePragerYamakawa damps them (placeInFormulas(),
 * weight()), and ForceCoupling needs no treatment.
 */
class ConfiningPlanes {
public:
    /** @throws OpenMMException if the planes are not finite, or the upper is not above the lower */
    ConfiningPlanes(const MobilityForce& force, bool crossingAllowed);

    MobilityForce::Boundary getBoundary() const { return boundary; }
    bool isChannel() const { return boundary == MobilityForce::NoSlipChannel; }
    bool isFilm() const { return boundary == MobilityForce::Film; }
    bool isWall() const { return boundary == MobilityForce::PeriodicWall; }
    /** z of the planes, nm. The upper one of a PeriodicWall is infinite. */
    double getLow() const { return low; }
    double getHigh() const { return high; }
    double getHeight() const { return high - low; }
    bool hasZeroFlux() const { return zeroFlux; }
    bool allowsCrossing() const { return crossingAllowed; }

    /**
     * @throws OpenMMException if a particle does not fit between the planes
     */
    void checkRadii(const HydrodynamicParticles& particles) const;
    /**
     * @throws OpenMMException if the box does not have two vectors along the planes and a third one
     *     normal to them. The message names the box and the remedy.
     */
    void checkBox(const BoxVectors& box) const;
    /**
     * The reason why a position is not allowed, with the name of the first such particle; empty if
     * all positions are allowed.
     */
    std::string objection(const HydrodynamicParticles& particles, const Placement& placement) const;
    /**
     * Whether all surfaces reach at most this part of a radius through a plane, and all centres are
     * within the fluid.
     */
    bool areWithin(const HydrodynamicParticles& particles, const Placement& placement,
                   double beyond) const;
    /** A particle moved to contact, if its surface reaches through a plane. */
    OpenMM::Vec3 placeInFormulas(const OpenMM::Vec3& position, double radius) const;
    /**
     * A particle's entry of B in M -> B M B: the distance from the nearer plane over the radius, at
     * most 1.
     */
    double weight(double z, double radius) const;
    /** The distance of z from the nearer plane. */
    double depth(double z) const;

private:
    const MobilityForce::Boundary boundary;
    double low, high;
    const bool zeroFlux, crossingAllowed;
};

}  // namespace RigidHIPlugin

#endif
