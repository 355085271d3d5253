#ifndef RIGIDHI_BODY_GEOMETRY_H_
#define RIGIDHI_BODY_GEOMETRY_H_

#include <openmm/System.h>
#include <openmm/Vec3.h>

#include <string>
#include <vector>

#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {

/** Mass, principal moments and site positions of a rigid body, in its body frame. */
struct BodyGeometry {
    double mass = 0;
    OpenMM::Vec3 moments;
    std::vector<OpenMM::Vec3> sites;
};

/**
 * A moment below this fraction of the largest is taken as zero. Rounding of positions leaves about
 * 1e-26 for the sites of a line.
 */
constexpr double zeroMomentFraction = 1e-13;

/** The inertia that the schemes use, with moments that count as zero set to zero. */
BodyInertia liveInertia(double mass, const OpenMM::Vec3& moments);

/**
 * The constraints of a System, by particle. Bodies look up their own constraints, so that each
 * constraint is visited a few times only.
 */
class ConstraintsOfParticles {
public:
    explicit ConstraintsOfParticles(const OpenMM::System& system);
    /** Call action(index of the constraint) for those that hold a particle, in ascending order. */
    template <class Action>
    void forEach(int particle, Action action) const {
        for (int i = first[particle]; i < first[particle + 1]; i++) action(constraints[i]);
    }

private:
    std::vector<int> first,
        constraints;  // those of particle p are from first[p] to before first[p + 1]
};

/**
 * Whether point masses at the sites have the mass and moments of a geometry, with its origin as
 * their centre and its axes as principal axes. The tolerance is 1e-10: far above rounding, far
 * below any intended difference.
 */
bool massesMake(const BodyGeometry& geometry, const std::vector<double>& masses);

/** In messages: what most likely happened to a body with redundant constraints. */
inline constexpr const char* whatMakesNanOfBodies =
    ". OpenMM's applyConstraints() and minimisers do that to a body whose constraints are "
    "redundant, as they are here; set finite positions again and call "
    "openmmrigidhi.app.placeBodies() instead, or raise setPoseTolerance() for a step";

/**
 * The shape, mass and inertia of a body that was given by its particles alone.
 *
 * The massive members' shape comes from the System's constraints where these fix it (one pair, a
 * triangle, or all pairs), else from positions. Virtual sites come from their definitions, and
 * other massless members from positions. The body frame has its origin at the centre of mass and
 * its axes along the principal axes, smallest moment first. A body of massless members has the
 * frame of equal weights, and no inertia.
 */
class BodyGeometryBuilder {
public:
    /**
     * @param constraints  those of the System, one object for all bodies
     * @param name         the body's name in error messages, such as "body 3"
     */
    BodyGeometryBuilder(const OpenMM::System& system, const ConstraintsOfParticles& constraints,
                        const std::vector<int>& particles, const std::string& name);
    /** Whether positions are needed. If not, the System alone fixes the geometry. */
    bool needsPositions() const;
    /** Whether constraints fix the distances of all massive members, of which there are several. */
    bool isFixedByConstraints() const { return fixedByConstraints && massive.size() > 1; }
    /**
     * Whether constraints fix all distances, and some constraints follow from the others to first
     * order: of three members on a line, four in a plane (nearly, too), or more. OpenMM's solver of
     * constraints then makes NaN of positions that do not fit.
     */
    bool hasRedundantConstraints() const;
    /**
     * @param members  positions of the body's particles in any frame, nm; not read unless
     *     needsPositions()
     * @throws OpenMMException if constraints cannot be satisfied, or positions are not finite
     */
    BodyGeometry build(const std::vector<OpenMM::Vec3>& members) const;
    /**
     * The geometry, by the present System, of a body whose shape was found earlier. It is the known
     * one to the last bit where the System still says the same. Otherwise it is built anew, with
     * the known sites as positions.
     */
    BodyGeometry update(const BodyGeometry& known) const;

private:
    bool agrees(const BodyGeometry& known) const;
    std::vector<OpenMM::Vec3> shapeFromDistances(const std::vector<OpenMM::Vec3>& members) const;
    const OpenMM::System& system;
    const std::vector<int>& particles;
    std::string name;
    std::vector<int> massive;  // indices into `particles`
    std::vector<double> masses;
    std::vector<std::vector<double>>
        distances;  // between massive members, if constraints fix all of them
    bool fixedByConstraints, hasOtherMassless, massless = false;
};

/**
 * The position of a virtual site, of a kind that turnsWithItsParents().
 *
 * @param system    the System
 * @param particle  index of the virtual site
 * @param position  gives the position of a particle that is not a virtual site, by its index
 */
template <class PositionOf>
OpenMM::Vec3 virtualSitePosition(const OpenMM::System& system, int particle, PositionOf position);

}  // namespace RigidHIPlugin

#include "rigidbody/VirtualSitePosition.h"

#endif
