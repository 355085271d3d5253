#include "fluid/FluidGroup.h"

#include <cmath>
#include <sstream>

#include "openmmrigidhi/internal/Errors.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * By rounding, forces on sites of a line give a torque about it of about 1e-16 of force times size.
 */
const double torqueTolerance = 1e-9;

}  // namespace

string FluidGroup::objectionTo(const BodySet& set, const vector<OpenMM::Vec3>& positions) {
    return answering->mayObject() ? answering->objection(readPoses(set, positions)) : string();
}

string FluidGroup::objectionToWhollyFixed(const BodySet& set,
                                          const vector<OpenMM::Vec3>& positions) const {
    if (!wholly || !wholly->hasModel() || !wholly->getModel().getTraits().mayObject) return {};
    vector<Pose> there(wholly->getElements().size());
    GroupMembers(*wholly).readPoses(set, positions, there);
    vector<Matrix3d> turns;
    setTurns(there, turns);
    Placement placement;
    placement.box = bodies.getBox();
    wholly->getMotion().place(there, turns, placement);
    return wholly->getModel().objection(placement);
}

/**
 * Check the power of a wrench on the rotation about the line, relative to the rounding errors of
 * forces at the sites.
 */
void FluidGroup::checkTorque(int e, const Matrix<double, 6, 1>& wrench_body,
                             double siteForces) const {
    if (!bodies.hasNullVector(e)) return;
    const FluidElement& element = bodies.getElements()[e];
    const double power = bodies.getNullVector_body(e).dot(wrench_body);
    double size = 0;
    for (const Vector3d& site : element.sites) size = max(size, site.norm());
    // Site forces may cancel in the wrench, but their rounding errors do not.
    const double scale =
        wrench_body.tail<3>().norm() + size * (wrench_body.head<3>().norm() + siteForces);
    if (abs(power) <= torqueTolerance * scale) return;
    ostringstream text;
    text << "body " << element.body << ": a torque of " << power
         << " kJ/mol acts about the line of its hydrodynamic particles, about which neither the "
            "fluid nor inertia resists rotation; this torque must be 0 within 1e-9 of force times "
            "size plus torque: remove the torque, or give the body hydrodynamic particles off the "
            "line";
    failFluid(text.str());
}

}  // namespace RigidHIPlugin
