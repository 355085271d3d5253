#ifndef RIGIDHI_NULL_TWISTS_H_
#define RIGIDHI_NULL_TWISTS_H_

#include <Eigen/Core>
#include <vector>

#include "rigid/FluidElement.h"

namespace RigidHIPlugin {

/**
 * The null vectors of the friction of bodies whose particles are on a line. Such a null vector is a
 * twist n = (V, line) that leaves all particles where they are: the rotation about the line (the
 * null vector of K).
 *
 * The inverse of a friction xi with such null vectors is the symmetric generalised inverse N (xi N
 * xi = xi, N xi N = N) whose twists do not turn bodies about their lines, W.line = 0. For an origin
 * on the line N is the pseudo-inverse. For any other origin the pseudo-inverse would depend on the
 * origin and on units, and N does not (docs/theory/multiblobs.md).
 *
 * Method: the friction is lifted along n before it is inverted or factorised, and the contribution
 * of the lift is removed from results.
 */
class NullTwists {
public:
    /** @param rows  first row of each element in twists and wrenches */
    explicit NullTwists(const std::vector<int>& rows)
        : rows(rows), twists_body(rows.size()), partlyFixed(rows.size()) {}
    /** Look for the null twist of an element from its sites, and keep it. */
    void find(int element, const std::vector<Eigen::Vector3d>& sites);
    /**
     * Note which components of the element are fixed. Where a fixed component takes part in the
     * null twist, the friction of what is free has no null twist, and holds the body against
     * torques about its line. Then only the fixed components are lifted.
     */
    void fix(int element, const FluidElement& components);
    bool has(int element) const { return twists_body[element].size() > 0; }
    bool any() const { return hasAny; }
    /** In the body frame, of unit length; empty if there is none. */
    const Eigen::VectorXd& inBody(int element) const { return twists_body[element]; }

    /**
     * Add friction along the null twists to the matrix of all bodies: the mean of its diagonal
     * elements.
     */
    void lift(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& friction) const;
    /** Turn the inverse of a lifted friction into the generalised inverse. */
    void project(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& inverse) const;
    /** Remove from twists the rotation of bodies about their lines. Each column is independent. */
    void removeTurns(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& twists) const;
    /** Remove from wrenches the torque that does work on the null twists. */
    void removeTorques(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& wrenches) const;
    /**
     * Remove from wrenches the component along the null twists, as in random wrenches made with a
     * lifted friction.
     */
    void removeLift(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& wrenches) const;
    /**
     * Remove from wrenches the multiple of n_o that leaves no work on n, where fixed components
     * have the part n_o of the null twist n.
     */
    void removeWorkOfFixed(const std::vector<Eigen::Matrix3d>& turns,
                           Eigen::MatrixXd& wrenches) const;
    /**
     * Slips do not tell how a body turns about its line. Where a fixed component takes part in this
     * rotation, turn the body such that its motion has nothing along the fixed part of the null
     * twist. Only then twists U with U = N_c K^T M^-1 s and the nearest twists V of slips s of
     * covariance M have <U V^T> = N_c in their free components.
     */
    void turnWithFixed(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& twists) const;
    /**
     * wrenches += factor sum_k d_k (p_i n_k), with p = n_o/(n_o.n_o) of the fixed part n_o of n,
     * and k over free components. With V of turnWithFixed(), the wrenches hold = K^T lambda of such
     * solves have <hold V^T> = xi N_c - 1 - p n^T in free components, of which the last term is no
     * part of the mean hold.
     */
    void addDivergenceOfTurns(const std::vector<Eigen::Matrix3d>& turns, double factor,
                              Eigen::MatrixXd& wrenches) const;

private:
    /** Those of elements that are not partly fixed; and the others, with their fixed part. */
    template <class Action>
    void forEach(const std::vector<Eigen::Matrix3d>& turns, const Action& action) const;
    template <class Action>
    void forPartlyFixed(const std::vector<Eigen::Matrix3d>& turns, const Action& action) const;

    const std::vector<int> rows;
    std::vector<Eigen::VectorXd> twists_body;
    struct PartlyFixed {
        bool is = false, inBody = false;
        unsigned fixed = 0;
        Eigen::Matrix3d axes;
    };
    std::vector<PartlyFixed> partlyFixed;
    bool hasAny = false;
};

/**
 * The generalised inverse of one body's friction in its own frame. There is at most one null vector
 * (of unit length; or empty).
 */
Eigen::MatrixXd generalisedInverse(const Eigen::MatrixXd& friction,
                                   const Eigen::VectorXd& nullVector);

}  // namespace RigidHIPlugin

#endif
