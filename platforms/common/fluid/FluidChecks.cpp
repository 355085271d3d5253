#include "fluid/FluidChecks.h"

#include <cmath>

#include "rigidbody/BodyPoses.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

string FluidChecks::objection(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) const {
    for (const auto& group : fluid.groups) {
        const string text = group->objectionTo(bodies, positions);
        if (!text.empty()) return text;
    }
    return {};
}

bool FluidChecks::mayObject() const {
    for (const auto& group : fluid.groups)
        if (group->answering->mayObject()) return true;
    return false;
}

void FluidChecks::checkTorques(const BodySet& bodies, const vector<OpenMM::Vec3>& forces) const {
    Matrix<double, 6, 1> wrench;
    Vector3d force, torque;
    for (const auto& group : fluid.groups) {
        if (!group->hasNullVectors) continue;
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (!group->bodies.hasNullVector(e)) continue;
            const int s = bodies.slot(elements[e].body);
            const Matrix3d A = poseOf(bodies, elements[e].body).rotation();
            for (int k = 0; k < 3; k++) {
                force[k] = bodies.force_lab[k][s];
                torque[k] = bodies.torque_lab[k][s];
            }
            wrench << A.transpose() * force, A.transpose() * torque;
            double siteForces = 0;
            for (int p : fluid.particlesOfBodies[elements[e].body])
                siteForces += sqrt(forces[p].dot(forces[p]));
            group->checkTorque(e, wrench, siteForces);
        }
    }
}

}  // namespace RigidHIPlugin
