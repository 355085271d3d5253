#include "mobility/models/wall/NoSlipPlane.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "openmmrigidhi/internal/Messages.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * A body's pose determines z of its particles only up to a few rounding errors of z, of the wall's
 * height or of the body's size, whichever is largest. The size is unknown here, so the tolerance is
 * many rounding errors: enough for bodies a thousand times as large as z and the height.
 */
const double touchTolerance = 1e-12;

}  // namespace

string particleAndBody(const HydrodynamicParticles& particles, int i) {
    return "particle " + to_string(particles.systemIndex[i]) +
           (particles.body[i] < 0 ? " (in no body)"
                                  : " (body " + to_string(particles.body[i]) + ")");
}

NoSlipPlane::NoSlipPlane(double height, bool crossingAllowed)
    : height(height), crossingAllowed(crossingAllowed) {
    if (!isfinite(height))
        throw OpenMM::OpenMMException("MobilityForce: the height of the no-slip wall is " +
                                      text(height) + " nm; it must be finite");
}

string NoSlipPlane::objection(const HydrodynamicParticles& particles,
                              const vector<OpenMM::Vec3>& positions) const {
    for (int i = 0; i < particles.size(); i++) {
        const double z = positions[i][2] - height, radius = particles.radii[i];
        const double rounding = touchTolerance * max(abs(positions[i][2]), abs(height));
        if (crossingAllowed ? z > 0 : z >= radius - rounding) continue;
        const string where = "NoSlipWall: " + particleAndBody(particles, i) + " has its centre " +
                             text(z) + " nm above the wall at z = " + text(height) + " nm";
        if (crossingAllowed)
            return where + ", where a particle (this one of radius " + text(radius) +
                   " nm) has no mobility; move it above the wall, or use smaller time steps";
        return where + ", less than its radius, " + text(radius) +
               " nm; move it up, use smaller time steps, or allow the overlap by "
               "setWallRejection(Crossing)";
    }
    return {};
}

bool NoSlipPlane::acceptsNearby(const HydrodynamicParticles& particles,
                                const vector<OpenMM::Vec3>& positions) const {
    if (!reachesBeyond()) return objection(particles, positions).empty();
    const double beyond = 0.01;  // of a radius: the matrix is still positive definite there
    for (int i = 0; i < particles.size(); i++)
        if (!(positions[i][2] - height >= (1 - beyond) * particles.radii[i])) return false;
    return true;
}

double NoSlipPlane::heightOver(double z, double radius) const { return max(z - height, radius); }

double NoSlipPlane::weight(double z, double radius) const {
    return crossingAllowed ? min((z - height) / radius, 1.0) : 1.0;
}

}  // namespace RigidHIPlugin
