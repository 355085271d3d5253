#ifndef RIGIDHI_JOINTS_H_
#define RIGIDHI_JOINTS_H_

#include <Eigen/Core>
#include <string>
#include <vector>

#include "rigid/CoupledBodies.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/** A joint between two elements, or between an element and a point of space. */
struct Joint {
    enum Kind { Ball, BallToPoint, Link, Hinge };
    Kind kind;
    int index;                 // in the integrator
    std::string name;          // for messages: the kind and the bodies (jointText())
    int i, j;                  // elements; j = -1: a point
    Eigen::Vector3d anchor_i;  // in the frame of i
    Eigen::Vector3d anchor_j;  // in the frame of j, or the point in the lab frame
    // Of a hinge: unit vectors in the frames of i and j.
    Eigen::Vector3d axis_i = Eigen::Vector3d::Zero(), axis_j = Eigen::Vector3d::Zero();
    double length = 0;  // of a link, nm
    int motor = -1;     // of a hinge, in the integrator; -1: none
    int firstRow = 0;   // of its conditions

    bool hasMotor() const { return motor >= 0; }
    int numRows() const { return kind == Link ? 1 : kind == Hinge ? (hasMotor() ? 6 : 5) : 3; }
    int motorRow() const { return firstRow + 5; }
};

/**
 * The conditions of joints on poses, c(Q) = 0, and on twists, C U = b, where C are the derivatives
 * of c along twists. b has the rates of motors and is 0 otherwise.
 *
 * Equation:  with the mobility N of bodies without joints (N_c where some are held),
 *            N_J = N - N C^T (C N C^T)^-1 C N,   mu = (C N C^T)^-1 (b - C N F).
 *            N_J is the mobility with joints; joints exert the wrenches C^T mu on bodies.
 * Rows:      ball    V_i + W_i x a_i - (the same of j), three components
 *            link    e.(V_i + W_i x a_i - ...), e the direction from j's anchor to i's
 *            hinge   a ball, and (W_j - W_i).(h_j x f_k) for two axes f_k of i across its axis
 *            motor   (W_j - W_i).h_i
 * Measure:   schemes sample the measure of infinitely stiff springs
 *            (docs/theory/held_and_driven.md).
 */
class Joints {
public:
    /**
     * @throws OpenMMException  if a joint or motor turns a free rod of blobs about its line, a
     *     rotation that nothing resists
     */
    Joints(const std::vector<Joint>& joints, const CoupledBodies& bodies);
    const std::vector<Joint>& getJoints() const { return joints; }
    int getNumRows() const { return numRows; }
    bool concerns(int element) const;

    /** C at poses: a row for each condition, a column for each row of twists. */
    void findRows(const std::vector<Pose>& poses, Eigen::MatrixXd& C) const;
    /** b from the rates of all motors of the integrator; empty where no joint here has one. */
    void findRightSides(const Eigen::VectorXd& rates, Eigen::VectorXd& b) const;
    /**
     * The angles of motors: of the second body relative to the first, about the axis, from some
     * reference. Each joint has an entry, 0 if it has no motor.
     */
    void findAngles(const std::vector<Pose>& poses, Eigen::VectorXd& angles) const;
    /** Add `turns`, which have an entry for each motor, to the angles of motors. */
    void turnBy(const Eigen::VectorXd& turns, Eigen::VectorXd& angles) const;
    /**
     * c at poses: nm; for the axes of hinges, the cosines of angles that should be right angles;
     * for motors, the differences from `angles` (null: motors have no error).
     */
    void findErrors(const std::vector<Pose>& poses, const Eigen::VectorXd* angles,
                    Eigen::VectorXd& c) const;
    /**
     * Invert C N C^T.
     *
     * @throws OpenMMException naming the joint, if a condition follows from the others or cannot be
     *     met
     */
    void factorise(const Eigen::MatrixXd& CNC, Eigen::MatrixXd& inverse) const;
    /**
     * Move poses, along the mobilities of bodies by themselves, until no condition is violated by
     * more than `tolerance`, or eight roundings of the largest coordinate (Newton's method). Since
     * errors of steps have the mean 0, the direction of the projection does not change what schemes
     * sample.
     *
     * @param mobilities_body  of the elements by themselves, in their frames
     * @param angles           to which motors turn: findAngles()
     * @throws OpenMMException if the projection fails, naming the joint
     */
    void project(const std::vector<Eigen::MatrixXd>& mobilities_body, double tolerance,
                 const Eigen::VectorXd& angles, std::vector<Pose>& poses) const;
    /**
     * @throws OpenMMException  naming the first joint whose bodies do not fit within `tolerance`,
     *     or whose axes have opposite directions
     */
    void check(const std::vector<Pose>& poses, double tolerance,
               const Eigen::VectorXd* angles = nullptr) const;
    /**
     * For each joint four rows: the force on i at its anchor, and below it the torque of a motor on
     * j about the axis. mu are the forces of the conditions.
     */
    void forces(const std::vector<Pose>& poses, const Eigen::VectorXd& mu,
                Eigen::MatrixXd& forces_lab) const;

private:
    void checkRods(const Joint& joint) const;
    Eigen::Vector3d anchor(const Joint& joint, bool second, const std::vector<Pose>& poses) const;
    void moveBy(const Eigen::VectorXd& twists, std::vector<Pose>& poses) const;

    std::vector<Joint> joints;
    const CoupledBodies& bodies;
    int numRows = 0;
};

}  // namespace RigidHIPlugin

#endif
