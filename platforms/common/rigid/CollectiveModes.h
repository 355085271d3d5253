#ifndef RIGIDHI_COLLECTIVE_MODES_H_
#define RIGIDHI_COLLECTIVE_MODES_H_

#include <Eigen/Core>
#include <vector>

#include "linearalgebra/CholeskyFactor.h"
#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * The collective motion of many bodies, for square roots of the mobility.
 *
 * Why:     Many bodies that sediment together are much faster than one body alone. The largest
 *          eigenvalue of the mobility therefore grows with their number n as n^(2/3), and the
 *          number of iterations of a square root as n^(1/3). Only few modes have such eigenvalues,
 *          and a coarse picture of the bodies describes these modes well enough.
 * Method:  Bodies near each other form a group. Y are orthonormal vectors, three for each group,
 *          that move the group as a whole. C is the mobility of one sphere for each group
 *          (MobilityModel::forCollectiveModes()), scaled by the friction of all bodies of the
 *          group. With C = L L^T,
 *
 *              B = 1 + Y (L - 1) Y^T,   S' = B^-1 S B^-T,   B S'^(1/2) W and B^-T S'^(-1/2) W
 *
 *          have the covariances S and S^-1 for any L, and the eigenvalues of S' hardly depend on n.
 *          The quality of the picture affects the number of iterations only. C contains half of a
 *          single body's mobility in addition, so that a group with a sphere that would reach into
 *          a wall does not seem slow.
 * Roots:   B belongs to one placement. As long as the caller keeps it, the roots are smooth
 *          functions of the poses; schemes that take differences of roots within a step need this.
 * Cost:    (3 groups)^3/3 operations for L, (3 groups)^2 for each product with it.
 */
class CollectiveModes {
public:
    /** A body, or a free particle, with its rows in the scaled vectors that S acts on. */
    struct Member {
        int firstRow;  // its first row
        /**
         * Three columns: the vectors that stand for the body's translations along x, y, z of the
         * lab frame. Their products with each other are the body's friction.
         */
        Eigen::MatrixXd translations;
        Eigen::Vector3d centre;
    };

    /**
     * The number of groups that saves time for this many members with this many particles; 0:
     * groups do not pay.
     */
    static int numGroups(int numMembers, int numParticles);
    /**
     * @param mostGroups  the largest number of groups
     * @return whether B has such modes; if not, B = 1
     */
    bool compute(const MobilityModel& model, const std::vector<Member>& members, int mostGroups);
    void clear();
    bool any() const { return !groups.empty(); }
    /** x <- B x */
    void multiply(Eigen::MatrixXd& x) const;
    /** x <- B^-1 x */
    void solve(Eigen::MatrixXd& x) const;
    /** x <- B^-T x */
    void solveTransposed(Eigen::MatrixXd& x) const;

private:
    struct Group {
        std::vector<int> members;
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        double friction = 0;  // over 6 pi viscosity
        double radius = 1;    // of the sphere that stands for it
    };
    void divide(const std::vector<Member>& members, int first, int end, int count);
    void measure(const std::vector<Member>& members, double viscosity);
    void makeVectors(const std::vector<Member>& members);
    template <class Act>
    void act(Eigen::MatrixXd& x, const Act& act) const;

    std::vector<int> order;
    std::vector<Group> groups;
    struct Vectors {
        int firstRow, group;
        Eigen::MatrixXd Y;
    };
    std::vector<Vectors> vectors;  // of members
    CholeskyFactor factor;
    mutable Eigen::MatrixXd modes, changed;
};

}  // namespace RigidHIPlugin

#endif
