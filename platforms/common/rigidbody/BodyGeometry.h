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
 * A moment below this fraction of the largest counts as zero. For sites on a line the rounding of
 * positions leaves about 1e-26.
 */
constexpr double zeroMomentFraction = 1e-13;

/** The inertia that the schemes use, with moments that count as zero set to zero. */
BodyInertia liveInertia(double mass, const OpenMM::Vec3& moments);

/**
 * The constraints of a System, by particle. Bodies look up their own constraints only, so each
 * constraint is visited only a few times.
 */
class ConstraintsOfParticles {
public:
    explicit ConstraintsOfParticles(const OpenMM::System& system);
    /** Call action(index) for each constraint that holds the particle, in ascending order. */
    template <class Action>
    void forEach(int particle, Action action) const {
        for (int i = first[particle]; i < first[particle + 1]; i++) action(constraints[i]);
    }

private:
    std::vector<int> first,
        constraints;  // particle p has constraints[first[p]] to constraints[first[p + 1] - 1]
};

/**
 * Whether point masses at the sites have the mass and moments of a geometry, their centre of mass
 * at its origin, and their principal axes along its axes. The tolerance is 1e-10: far above
 * rounding, far below any intended difference.
 */
bool massesMake(const BodyGeometry& geometry, const std::vector<double>& masses);

/** The most likely cause of NaN in a body with redundant constraints, for messages. */
inline constexpr const char* whatMakesNanOfBodies =
    ". OpenMM's applyConstraints() and minimisers do that to a body whose constraints are "
    "redundant, as they are here; set finite positions again and call "
    "openmmrigidhi.app.placeBodies() instead, or raise setPoseTolerance() for a step";

/**
 * The shape, mass and inertia of a body that was given by its particles alone.
 *
 * The shape of the massive members comes from the System's constraints if these fix it (one pair, a
 * triangle, or all pairs), and from positions otherwise. Virtual sites come from their definitions,
 * and other massless members from positions. The body frame has its origin at the centre of mass
 * and its axes along the principal axes, smallest moment first. A body of massless members has no
 * inertia; its frame is that of equal weights.
 */
class BodyGeometryBuilder {
public:
    /**
     * @param constraints  of the System; one object serves all bodies
     * @param name         the body's name in error messages, such as "body 3"
     */
    BodyGeometryBuilder(const OpenMM::System& system, const ConstraintsOfParticles& constraints,
                        const std::vector<int>& particles, const std::string& name);
    /** Whether build() needs positions. If not, the System alone fixes the geometry. */
    bool needsPositions() const;
    /**
     * Whether the body has several massive members and constraints fix all distances between them.
     */
    bool isFixedByConstraints() const { return fixedByConstraints && massive.size() > 1; }
    /**
     * Whether constraints fix all distances, and some of them follow from the others to first
     * order. This is so for three members on a line, four in a plane (also if nearly so), and more
     * than four members. OpenMM's constraint solver then turns positions that do not fit into NaN.
     */
    bool hasRedundantConstraints() const;
    /**
     * @param members  positions of the body's particles in any frame, nm; not read unless
     *     needsPositions()
     * @throws OpenMMException if constraints cannot be satisfied, or positions are not finite
     */
    BodyGeometry build(const std::vector<OpenMM::Vec3>& members) const;
    /**
     * The geometry of a body whose shape was found earlier, according to the present System. As
     * long as the System agrees with the known geometry, this is the known geometry to the last
     * bit. Otherwise it is built anew, with the known sites as positions.
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
 * The position of a virtual site that turnsWithItsParents().
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
