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
 * L^-1, with the Cholesky factor L of their mobility where they are. It is made once, as long as
 * they stay there.
 *
 * What it costs is to read numbers from memory, once an iteration. It is therefore kept as L^-1, of
 * which each panel of rows serves both products while it is in the cache, and in single precision
 * where the block is conditioned well enough for that. The block is symmetric and positive to its
 * rounding. Neither changes what the iterations converge to.
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
    /** Of the block, as its inverse condition number. */
    double getCondition() const { return condition; }
    /** The first rows of `to`, which has its size, become M~^-1 those of `from`; in the frames of
     * the bodies. */
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
