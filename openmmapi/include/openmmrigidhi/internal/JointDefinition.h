#ifndef OPENMMRIGIDHI_JOINT_DEFINITION_H_
#define OPENMMRIGIDHI_JOINT_DEFINITION_H_

#include <openmm/Vec3.h>

#include <string>

namespace RigidHIPlugin {

/**
 * A joint of CustomRigidHIIntegrator, as its user defined it.
 *
 * Anchors and axes are in the user's body frames, as are the site positions of the bodies.
 */
struct JointDefinition {
    enum Kind : int {
        /** The anchors of two bodies are at one place: addBallJoint(). */
        Ball = 0,
        /** The anchor of a body is at a fixed point of space: addBallJointToPoint(). */
        BallToPoint = 1,
        /** The anchors of two bodies have a fixed distance: addLink(). */
        Link = 2,
        /** A ball joint whose bodies have one axis in common: addHinge(). */
        Hinge = 3
    };
    Kind kind = Ball;
    /** The index of the first body. */
    int i = -1;
    /** The index of the second body; -1 for BallToPoint. */
    int j = -1;
    /** The anchor in the first body, nm. */
    OpenMM::Vec3 anchor_i;
    /** The anchor in the second body, nm; for BallToPoint the point of space, lab frame, nm. */
    OpenMM::Vec3 anchor_j;
    /**
     * For Hinge: unit vectors along the axis of the hinge, in the first and the second body; 0 for
     * other kinds.
     */
    OpenMM::Vec3 axis_i, axis_j;
    /** For Link: the distance of the anchors, nm; 0 for other kinds. */
    double length = 0;
};

/** A motor of CustomRigidHIIntegrator, as its user defined it. */
struct HingeMotorDefinition {
    /** The index of the joint, which is a hinge. */
    int hinge = -1;
    /** The angular velocity of the second body relative to the first, about the axis, rad/ps. */
    double rate = 0;
};

/** The kinds by their numbers, as in XML and in Python. */
constexpr const char* jointKindNames[] = {"Ball", "BallToPoint", "Link", "Hinge"};

/** A joint for messages, such as "joint 2 (a link of body 0 and body 1)". */
inline std::string jointText(int index, const JointDefinition& joint) {
    const bool isToPoint = joint.kind == JointDefinition::BallToPoint;
    const char* kind = joint.kind == JointDefinition::Link    ? "link"
                       : joint.kind == JointDefinition::Hinge ? "hinge"
                                                              : "ball";
    return "joint " + std::to_string(index) + " (a " + kind + " of body " +
           std::to_string(joint.i) + " and " +
           (isToPoint ? "a point" : "body " + std::to_string(joint.j)) + ")";
}

}  // namespace RigidHIPlugin

#endif
