#include "rigid/Joints.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <sstream>

#include "linearalgebra/Decompositions.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Two axes across an axis, in the frame of i; they determine the rows of a hinge. */
void axesAcross(const Vector3d& axis, Vector3d across[2]) {
    across[0] = axis.unitOrthogonal();
    across[1] = axis.cross(across[0]);
}

}  // namespace

Joints::Joints(const vector<Joint>& jointsToUse, const CoupledBodies& bodies)
    : joints(jointsToUse), bodies(bodies) {
    for (Joint& joint : joints) {
        joint.firstRow = numRows;
        numRows += joint.numRows();
        checkRods(joint);
    }
}

/** The rotation of a free rod about its line leaves all blobs where they are. */
void Joints::checkRods(const Joint& joint) const {
    const double rounding = 1e-9;
    for (int e : {joint.i, joint.j}) {
        if (e < 0 || !bodies.hasNullVector(e) || !bodies.getElements()[e].isWhollyFree()) continue;
        const VectorXd& twist = bodies.getNullTwists().inBody(e);
        const Vector3d V = twist.head<3>(), W = twist.tail<3>(),
                       a = e == joint.i ? joint.anchor_i : joint.anchor_j,
                       h = e == joint.i ? joint.axis_i : joint.axis_j;
        const bool turns = (V + W.cross(a)).norm() > rounding * (1 + a.norm()) * W.norm() ||
                           h.cross(W).norm() > rounding * W.norm() || joint.hasMotor();
        if (turns)
            throw OpenMM::OpenMMException(
                "CustomRigidHIIntegrator: " + joint.name +
                (joint.hasMotor() ? " with a motor" : "") + " turns body " +
                to_string(bodies.getElements()[e].body) +
                " about the line of its hydrodynamic particles, which nothing resists; put the "
                "anchor and the axis on this line and leave the motor out, or give the body "
                "particles off the line");
    }
}

void Joints::findRightSides(const VectorXd& rates, VectorXd& b) const {
    b.resize(0);
    for (const Joint& joint : joints) {
        if (!joint.hasMotor()) continue;
        if (b.size() == 0) b.setZero(numRows);
        b[joint.motorRow()] = rates[joint.motor];
    }
}

void Joints::findAngles(const vector<Pose>& poses, VectorXd& angles) const {
    angles.setZero(joints.size());
    for (size_t k = 0; k < joints.size(); k++) {
        const Joint& joint = joints[k];
        if (!joint.hasMotor()) continue;
        Vector3d across_i[2], across_j[2];
        axesAcross(joint.axis_i, across_i);
        axesAcross(joint.axis_j, across_j);
        const Vector3d f =
            poses[joint.i].rotation().transpose() * (poses[joint.j].rotation() * across_j[0]);
        angles[k] = atan2(f.dot(across_i[1]), f.dot(across_i[0]));
    }
}

void Joints::turnBy(const VectorXd& turns, VectorXd& angles) const {
    for (size_t k = 0; k < joints.size(); k++)
        if (joints[k].hasMotor()) angles[k] += turns[joints[k].motor];
}

bool Joints::concerns(int element) const {
    for (const Joint& joint : joints)
        if (joint.i == element || joint.j == element) return true;
    return false;
}

/** From the origin of i or j to its anchor, lab frame. */
Vector3d Joints::anchor(const Joint& joint, bool second, const vector<Pose>& poses) const {
    return second ? Vector3d(poses[joint.j].rotation() * joint.anchor_j)
                  : Vector3d(poses[joint.i].rotation() * joint.anchor_i);
}

void Joints::findErrors(const vector<Pose>& poses, const VectorXd* angles, VectorXd& c) const {
    c.setZero(numRows);
    VectorXd here;
    if (angles) findAngles(poses, here);
    for (const Joint& joint : joints) {
        const Vector3d x_i = poses[joint.i].R + anchor(joint, false, poses),
                       x_j = joint.j < 0 ? joint.anchor_j
                                         : Vector3d(poses[joint.j].R + anchor(joint, true, poses));
        if (joint.kind == Joint::Link) {
            c[joint.firstRow] = (x_i - x_j).norm() - joint.length;
            continue;
        }
        c.segment<3>(joint.firstRow) = x_i - x_j;
        if (joint.kind != Joint::Hinge) continue;
        Vector3d across[2];
        axesAcross(joint.axis_i, across);
        const Matrix3d A_i = poses[joint.i].rotation();
        const Vector3d h_j = poses[joint.j].rotation() * joint.axis_j;
        for (int k = 0; k < 2; k++) c[joint.firstRow + 3 + k] = h_j.dot(A_i * across[k]);
        if (!angles || !joint.hasMotor()) continue;
        const int k = &joint - joints.data();
        c[joint.motorRow()] = remainder(here[k] - (*angles)[k], 2 * M_PI);
    }
}

void Joints::findRows(const vector<Pose>& poses, MatrixXd& C) const {
    C.setZero(numRows, bodies.getNumRows());
    // Add sign times e.(V + W x a) of an element to a row.
    const auto put = [&](int row, int element, const Vector3d& e, const Vector3d& a, double sign) {
        const int column = bodies.firstRow(element);
        C.block<1, 3>(row, column) += sign * e.transpose();
        if (!bodies.getElements()[element].isFree())
            C.block<1, 3>(row, column + 3) += sign * a.cross(e).transpose();
    };
    for (const Joint& joint : joints) {
        const Vector3d a_i = anchor(joint, false, poses);
        const Vector3d a_j = joint.j < 0 ? Vector3d::Zero() : anchor(joint, true, poses);
        if (joint.kind == Joint::Link) {
            const Vector3d r = poses[joint.i].R + a_i - poses[joint.j].R - a_j, e = r.normalized();
            put(joint.firstRow, joint.i, e, a_i, 1);
            put(joint.firstRow, joint.j, e, a_j, -1);
            continue;
        }
        for (int k = 0; k < 3; k++) {
            put(joint.firstRow + k, joint.i, Vector3d::Unit(k), a_i, 1);
            if (joint.j >= 0) put(joint.firstRow + k, joint.j, Vector3d::Unit(k), a_j, -1);
        }
        if (joint.kind != Joint::Hinge) continue;
        Vector3d across[2];
        axesAcross(joint.axis_i, across);
        const Matrix3d A_i = poses[joint.i].rotation();
        const Vector3d h_j = poses[joint.j].rotation() * joint.axis_j;
        for (int k = 0; k < 2; k++) {
            const Vector3d u = h_j.cross(A_i * across[k]);
            C.block<1, 3>(joint.firstRow + 3 + k, bodies.firstRow(joint.i) + 3) -= u.transpose();
            C.block<1, 3>(joint.firstRow + 3 + k, bodies.firstRow(joint.j) + 3) += u.transpose();
        }
        if (!joint.hasMotor()) continue;
        const Vector3d h_i = A_i * joint.axis_i;
        C.block<1, 3>(joint.motorRow(), bodies.firstRow(joint.i) + 3) -= h_i.transpose();
        C.block<1, 3>(joint.motorRow(), bodies.firstRow(joint.j) + 3) += h_i.transpose();
    }
}

void Joints::factorise(const MatrixXd& CNC, MatrixXd& inverse) const {
    const VectorXd scale = CNC.diagonal().cwiseMax(0).cwiseSqrt().cwiseInverse();
    const double singular = 1e-10;  // of scaled rows
    int worst = -1;
    if (!scale.allFinite()) {
        CNC.diagonal().minCoeff(&worst);
    } else {
        const MatrixXd scaled = scale.asDiagonal() * CNC * scale.asDiagonal();
        const LDLT<MatrixXd> factor(scaled);  // with pivots
        int place;
        if (factor.vectorD().minCoeff(&place) > singular) {
            inverse = factor.solve(MatrixXd::Identity(numRows, numRows));
            inverse = scale.asDiagonal() * inverse * scale.asDiagonal();
            return;
        }
        // Find the row that pivoting moved to this place.
        const auto& swaps = factor.transpositionsP().indices();
        worst = place;
        for (int k = place; k >= 0; k--)
            if (swaps[k] == worst)
                worst = k;
            else if (k == worst)
                worst = swaps[k];
    }
    for (const Joint& joint : joints)
        if (worst < joint.firstRow + joint.numRows())
            throw OpenMM::OpenMMException(
                "CustomRigidHIIntegrator: " + joint.name +
                " has a condition that follows from the conditions of other joints, or that is on "
                "a motion that does not exist (two joints at one place, closed loops, bodies that "
                "cannot move, a ball off the line of a rod of blobs); remove the joint, or use a "
                "joint that leaves this motion free");
}

void Joints::moveBy(const VectorXd& twists, vector<Pose>& poses) const {
    for (size_t e = 0; e < poses.size(); e++) {
        const int row = bodies.firstRow(e);
        if (!concerns(e)) continue;
        poses[e].R += twists.segment<3>(row);
        if (bodies.getElements()[e].isFree()) continue;
        const Vector3d turn = twists.segment<3>(row + 3);
        poses[e].q = scalar::exponential(
                         scalar::Vector3<double>{0.5 * turn.x(), 0.5 * turn.y(), 0.5 * turn.z()}) *
                     poses[e].q;
        scalar::renormalise(poses[e].q);
    }
}

/** The tolerance, or the rounding of the differences of positions where this is larger. */
static double beyondRounding(double tolerance, const vector<Pose>& poses) {
    const double roundings = 8;
    double farthest = 0;
    for (const Pose& pose : poses) farthest = max(farthest, pose.R.cwiseAbs().maxCoeff());
    return max(tolerance, roundings * numeric_limits<double>::epsilon() * farthest);
}

void Joints::project(const vector<MatrixXd>& mobilities_body, double wanted, const VectorXd& angles,
                     vector<Pose>& poses) const {
    const double tolerance = beyondRounding(wanted, poses);
    const int most = 20;
    VectorXd c;
    MatrixXd C, own = MatrixXd::Zero(bodies.getNumRows(), bodies.getNumRows()), inverse;
    for (int iteration = 0; iteration < most; iteration++) {
        findErrors(poses, &angles, c);
        if (!c.allFinite()) return;  // the step itself reports this
        if (c.cwiseAbs().maxCoeff() <= tolerance) break;
        findRows(poses, C);
        for (size_t e = 0; e < poses.size(); e++) {
            const FluidElement& element = bodies.getElements()[e];
            const int row = bodies.firstRow(e), rows = element.numRows();
            auto block = own.block(row, row, rows, rows);
            if (element.isFree()) {
                block = mobilities_body[e];
                continue;
            }
            const Matrix<double, 6, 6> turn = twoRotations(poses[e].rotation());
            block = turn * mobilities_body[e] * turn.transpose();
        }
        vector<Matrix3d> turns;
        setTurns(poses, turns);
        MatrixXd along = own * C.transpose();
        bodies.getFreeMotion().removeFixed(turns, along);
        factorise(C * along, inverse);
        moveBy(-along * (inverse * c), poses);
    }
    check(poses, tolerance, &angles);
}

void Joints::check(const vector<Pose>& poses, double wanted, const VectorXd* angles) const {
    const double tolerance = beyondRounding(wanted, poses);
    VectorXd c;
    findErrors(poses, angles, c);
    for (const Joint& joint : joints) {
        double error = c.segment(joint.firstRow, joint.numRows()).cwiseAbs().maxCoeff();
        // Axes of opposite directions meet all conditions of a hinge, but are refused.
        if (joint.kind == Joint::Hinge) {
            const double cosine = (poses[joint.i].rotation() * joint.axis_i)
                                      .dot(poses[joint.j].rotation() * joint.axis_j);
            if (cosine < 0) error = acos(max(cosine, -1.0));
        }
        if (error <= tolerance) continue;
        ostringstream text;
        text
            << "CustomRigidHIIntegrator: " << joint.name << " is violated by " << error
            << " nm (or radians), above " << tolerance
            << "; place its bodies so that their anchors, axes and distance fit, or take a smaller "
               "step";
        throw OpenMM::OpenMMException(text.str());
    }
}

void Joints::forces(const vector<Pose>& poses, const VectorXd& mu, MatrixXd& forces_lab) const {
    forces_lab.setZero(4, joints.size());
    for (size_t k = 0; k < joints.size(); k++) {
        const Joint& joint = joints[k];
        if (joint.hasMotor()) forces_lab(3, k) = mu[joint.motorRow()];
        if (joint.kind != Joint::Link) {
            forces_lab.col(k).head<3>() = mu.segment<3>(joint.firstRow);
            continue;
        }
        const Vector3d r = poses[joint.i].R + anchor(joint, false, poses) - poses[joint.j].R -
                           anchor(joint, true, poses);
        forces_lab.col(k).head<3>() = mu[joint.firstRow] * r.normalized();
    }
}

}  // namespace RigidHIPlugin
