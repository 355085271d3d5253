#include "fluid/FluidChecks.h"

#include <openmm/OpenMMException.h>

#include <cmath>

#include "rigidbody/BodyPoses.h"
#include "rigidbody/EigenVec3.h"

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

string FluidChecks::objectionToWhollyFixed(const BodySet& bodies,
                                           const vector<OpenMM::Vec3>& positions) const {
    for (const auto& group : fluid.groups) {
        const string text = group->objectionToWhollyFixed(bodies, positions);
        if (!text.empty()) return text;
    }
    return {};
}

void refusePrescribedMotion(const string& objection) {
    throw OpenMM::OpenMMException(
        "CustomRigidHIIntegrator: a prescribed motion leads to where the fluid has no mobility, "
        "which no noise can mend: " +
        objection + "; change the expressions of the CustomBodyMotion, or move what is in its way");
}

bool FluidChecks::mayObject() const {
    for (const auto& group : fluid.groups)
        if (group->answering->mayObject()) return true;
    return false;
}

void FluidChecks::checkTorques(const BodySet& bodies, const vector<OpenMM::Vec3>& forces) const {
    Matrix<double, 6, 1> wrench_body;
    for (const auto& group : fluid.groups) {
        if (!group->hasNullVectors) continue;
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (!group->bodies.hasNullVector(e) || !elements[e].isWhollyFree()) continue;
            const int b = elements[e].body;
            const Matrix3d A = poseOf(bodies, b).rotation();
            wrench_body << A.transpose() * toEigen(bodies.getForce_lab(b)),
                A.transpose() * toEigen(bodies.getTorque_lab(b));
            double siteForces = 0;
            for (int p : fluid.particlesOfBodies[elements[e].body])
                siteForces += sqrt(forces[p].dot(forces[p]));
            group->checkTorque(e, wrench_body, siteForces);
        }
    }
}

}  // namespace RigidHIPlugin
