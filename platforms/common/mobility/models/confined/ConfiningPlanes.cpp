#include "mobility/models/confined/ConfiningPlanes.h"

#include <algorithm>
#include <cmath>

#include "mobility/Models.h"
#include "mobility/models/wall/NoSlipPlane.h"
#include "openmmrigidhi/internal/Errors.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

/** A pose determines z of its particles only up to a few rounding errors (NoSlipPlane.cpp). */
const double touchTolerance = 1e-12;

}  // namespace

ConfiningPlanes::ConfiningPlanes(const MobilityForce& force, bool crossingAllowed)
    : boundary(force.getBoundary()),
      zeroFlux(force.getChannelCondition() == MobilityForce::ZeroFlux),
      crossingAllowed(crossingAllowed) {
    findWalls(force, low, high);
}

void ConfiningPlanes::checkRadii(const HydrodynamicParticles& particles) const {
    for (int i = 0; i < particles.size(); i++)
        if (!(2 * particles.radii[i] <= getHeight()))
            failFluid(string(boundaryName(boundary)) + " has its planes at z = " + text(low) +
                      " and " + text(high) + " nm, nearer to each other than the diameter of " +
                      particleAndBody(particles, i) + ", " + text(2 * particles.radii[i]) +
                      " nm; move them apart by setChannelWalls(), or make the particle smaller");
}

void ConfiningPlanes::checkBox(const BoxVectors& box) const {
    const string name = boundaryName(boundary);
    if (!(box[0][0] > 0 && box[1][1] > 0))
        failFluid(name +
                  " needs a periodic box, but the System has none; set a box by "
                  "setDefaultPeriodicBoxVectors() on the System");
    if (box[2][0] != 0 || box[2][1] != 0)
        failFluid(name +
                  " needs a box whose third vector is along z, but the box has the vectors " +
                  text(box[0]) + ", " + text(box[1]) + ", " + text(box[2]) +
                  " nm; set another box by setPeriodicBoxVectors() on the Context");
}

double ConfiningPlanes::depth(double z) const { return min(z - low, high - z); }

string ConfiningPlanes::objection(const HydrodynamicParticles& particles,
                                  const Placement& placement) const {
    for (int i = 0; i < particles.size(); i++) {
        const double z = placement.positions[i][2], radius = particles.radii[i],
                     rounding = touchTolerance * max({abs(z), abs(low), isWall() ? 0 : abs(high)});
        if (crossingAllowed ? depth(z) > 0 : depth(z) >= radius - rounding) continue;
        const string where =
            string(boundaryName(boundary)) + ": " + particleAndBody(particles, i) +
            " has its centre at z = " + text(z) + " nm, with " +
            (isWall() ? "the wall at z = " + text(low) + " nm"
                      : (isFilm() ? "the wall at z = " + text(low) + " nm and the surface at z = "
                                  : "walls at z = " + text(low) + " and ") +
                            text(high) + " nm");
        if (crossingAllowed)
            return where + ", where a particle (this one of radius " + text(radius) +
                   " nm) has no mobility; move it into the fluid, or use smaller time steps";
        return where + ", nearer to a plane than its radius, " + text(radius) +
               " nm; move it away from the plane, use smaller time steps, or allow the overlap by "
               "setWallRejection(Crossing)";
    }
    return {};
}

bool ConfiningPlanes::areWithin(const HydrodynamicParticles& particles, const Placement& placement,
                                double beyond) const {
    for (int i = 0; i < particles.size(); i++) {
        const double inside = depth(placement.positions[i][2]);
        if (!(inside > 0 && inside >= (1 - beyond) * particles.radii[i])) return false;
    }
    return true;
}

OpenMM::Vec3 ConfiningPlanes::placeInFormulas(const OpenMM::Vec3& position, double radius) const {
    return OpenMM::Vec3(position[0], position[1],
                        min(max(position[2], low + radius), high - radius));
}

double ConfiningPlanes::weight(double z, double radius) const {
    return min(1.0, depth(z) / radius);
}

}  // namespace RigidHIPlugin
