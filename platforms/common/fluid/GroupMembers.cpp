#include "fluid/GroupMembers.h"

#include <cmath>

#include "rigidbody/BodyPoses.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

void GroupMembers::readPoses(const BodySet& set, const vector<OpenMM::Vec3>& positions,
                             vector<Pose>& poses) const {
    const auto& elements = bodies.getElements();
    for (size_t e = 0; e < elements.size(); e++)
        if (elements[e].isFree())
            poses[e].R = toEigen(positions[elements[e].particles[0]]);
        else
            poses[e] = poseOf(set, elements[e].body);
}

void GroupMembers::readForces(const BodySet& set, const FreeParticles& freeParticles,
                              MatrixXd& forces) const {
    const auto& elements = bodies.getElements();
    for (size_t e = 0; e < elements.size(); e++) {
        double* to = &forces(bodies.firstRow(e), 0);
        if (elements[e].isFree()) {
            const OpenMM::Vec3 force = freeParticles.getForce(freeIndex[e]);
            for (int k = 0; k < 3; k++) to[k] = force[k];
            continue;
        }
        const OpenMM::Vec3 force = set.getForce_lab(elements[e].body),
                           torque = set.getTorque_lab(elements[e].body);
        for (int k = 0; k < 3; k++) {
            to[k] = force[k];
            to[3 + k] = torque[k];
        }
    }
}

bool GroupMembers::writePoses(const vector<Pose>& poses, BodySet& set,
                              vector<OpenMM::Vec3>& positions) const {
    const auto& elements = bodies.getElements();
    double sum = 0;
    for (size_t e = 0; e < elements.size(); e++) {
        const Pose& place = poses[e];
        sum += place.R.sum();
        if (elements[e].isFree()) {
            positions[elements[e].particles[0]] = toVec3(place.R);
            continue;
        }
        const int s = set.slot(elements[e].body);
        for (int k = 0; k < 3; k++) set.R[k][s] = place.R[k];
        set.q[0][s] = place.q.w;
        set.q[1][s] = place.q.x;
        set.q[2][s] = place.q.y;
        set.q[3][s] = place.q.z;
        sum += place.q.w + place.q.x + place.q.y + place.q.z;
    }
    return isfinite(sum);
}

void GroupMembers::readTwists(const BodySet& set, const vector<OpenMM::Vec3>& velocities,
                              const MatrixXd* prescribed, MatrixXd& twists) const {
    const auto& elements = bodies.getElements();
    twists.setZero(bodies.getNumRows(), 1);
    for (size_t e = 0; e < elements.size(); e++) {
        const int row = bodies.firstRow(e), body = elements[e].body;
        if (elements[e].isWhollyFixed()) continue;
        if (elements[e].isFree()) {
            twists.block<3, 1>(row, 0) = toEigen(velocities[elements[e].particles[0]]);
            continue;
        }
        twists.block<3, 1>(row, 0) = toEigen(set.getState(body).p) / set.inertia(body).mass;
        twists.block<3, 1>(row + 3, 0) = toEigen(set.getAngularVelocity_lab(body));
    }
    MatrixXd values, ofFixed;
    if (!readPrescribed(prescribed, values)) return;
    vector<Matrix3d> turns(elements.size(), Matrix3d::Identity());
    for (size_t e = 0; e < elements.size(); e++)
        if (!elements[e].isFree()) turns[e] = poseOf(set, elements[e].body).rotation();
    bodies.getFreeMotion().motionOfFixed(turns, values, ofFixed);
    twists += ofFixed;
}

bool GroupMembers::readPrescribed(const MatrixXd* values, MatrixXd& ofElements) const {
    if (!values) return false;
    const auto& elements = bodies.getElements();
    bool any = false;
    ofElements.setZero(bodies.getNumRows(), 1);
    for (size_t e = 0; e < elements.size(); e++) {
        if (elements[e].isFree() || elements[e].isHeld || elements[e].isWhollyFree()) continue;
        ofElements.middleRows<6>(bodies.firstRow(e)) = values->col(elements[e].body);
        any = true;
    }
    return any;
}

}  // namespace RigidHIPlugin
