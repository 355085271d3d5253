#ifndef RIGIDHI_OWN_TENSORS_H_
#define RIGIDHI_OWN_TENSORS_H_

#include <Eigen/Core>
#include <vector>

#include "rigid/SlowedSpin.h"

namespace RigidHIPlugin {

/**
 * Own tensors of bodies. They enter by a congruence: N = B N_model B^T, B = N_own^(1/2)
 * N_alone^(-1/2). Each B is computed in the frame of its body, for the body alone in unbounded
 * fluid. At a wall a body's own tensor therefore feels the wall as the model's tensor does.
 *
 * Turns are the rotations of the bodies, body to lab.
 */
class OwnTensors {
public:
    using Matrix6d = Eigen::Matrix<double, 6, 6>;
    using Turns = std::vector<Eigen::Matrix3d>;

    /** @param rows  first row of each element in twists and wrenches */
    explicit OwnTensors(const std::vector<int>& rows) : rows(rows), factors(rows.size()) {}
    /**
     * @param alone  the model's mobility of the body by itself, body frame
     * @param spin   if it is slowed, SlowedSpin::congruence() multiplies B from the left
     */
    void set(int element, const Eigen::MatrixXd& own, const Eigen::MatrixXd& alone,
             const SlowedSpin& spin);
    bool any() const { return hasAny; }

    /** N = B N_model B^T, and xi = B^-T xi_model B^-1. */
    void mobility(const Turns& turns, Eigen::MatrixXd& matrix) const;
    void friction(const Turns& turns, Eigen::MatrixXd& matrix) const;
    /**
     * B twists; B^T wrenches, for wrenches that go to the model; B^-T wrenches, for random wrenches
     * that come from the model.
     */
    void twists(const Turns& turns, Eigen::MatrixXd& vectors) const;
    void wrenchesForModel(const Turns& turns, Eigen::MatrixXd& vectors) const;
    void wrenchesFromModel(const Turns& turns, Eigen::MatrixXd& vectors) const;

private:
    enum Kind { B, TransposedB, InverseTransposedB };
    /** The factor of an element, in the lab frame. */
    Matrix6d factor(int element, Kind kind, const Eigen::Matrix3d& turn) const;
    void congruence(const Turns& turns, Kind kind, Eigen::MatrixXd& matrix) const;
    void multiply(const Turns& turns, Kind kind, Eigen::MatrixXd& vectors) const;

    const std::vector<int> rows;
    struct Factors {
        bool exist = false;
        Matrix6d B_body, inverseB_body;
    };
    std::vector<Factors> factors;  // of elements
    bool hasAny = false;
};

}  // namespace RigidHIPlugin

#endif
