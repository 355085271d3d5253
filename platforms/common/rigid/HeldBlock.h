#ifndef RIGIDHI_HELD_BLOCK_H_
#define RIGIDHI_HELD_BLOCK_H_

#include <Eigen/Core>
#include <vector>

#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

class MobilityModel;
class RigidMotion;

/**
 * The blobs of all held bodies as one block of the preconditioner of MultiblobSolver: M~^-1 = L^-T
 * L^-1, with the Cholesky factor L of their mobility at their poses. The block is made anew only
 * when a held body has another pose.
 *
 * The cost is that of reading the block from memory once in each iteration. The class therefore
 * keeps L^-1, so that each panel of rows serves both products while it is in the cache, and keeps
 * it in single precision if the block's condition allows this. The preconditioner stays symmetric
 * and positive definite to its rounding. Neither choice changes the limit of the iterations.
 */
class HeldBlock {
public:
    HeldBlock(const RigidMotion& motion, const MobilityModel& model);
    /** Rows of held blobs, which come first. */
    int getNumRows() const { return numRows; }
    /**
     * @return whether the block was made anew
     * @throws OpenMMException if two blobs are at one place
     */
    bool setPoses(const std::vector<Pose>& poses, const std::vector<Eigen::Matrix3d>& turns);
    /** The inverse condition number of the block. */
    double getCondition() const { return condition; }
    /**
     * Set the first rows of `to`, which has the right size already, to M~^-1 times the first rows
     * of `from`; in the frames of the bodies.
     */
    void apply(const Eigen::MatrixXd& from, Eigen::MatrixXd& to);

private:
    /** L^-1 in one precision, panel by panel, each without the zeros to its right. */
    template <class Number>
    struct Inverse {
        std::vector<Number> panels;
        Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic> x, ofPanel, sum;
        void set(const Eigen::MatrixXd& lower);
        void apply(const Eigen::MatrixXd& from, Eigen::MatrixXd& to);
    };
    void findMobility(const std::vector<Pose>& poses, const std::vector<Eigen::Matrix3d>& turns,
                      Eigen::MatrixXd& M) const;

    const RigidMotion& motion;
    const MobilityModel& model;
    int numHeld = 0, numRows = 0;
    std::vector<Pose> heldPoses;
    double condition = 1;
    bool isSingle = true;
    Inverse<float> single;
    Inverse<double> exact;
};

}  // namespace RigidHIPlugin

#endif
