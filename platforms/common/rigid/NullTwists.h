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
 * A friction xi with such null vectors has no inverse. The symmetric generalised inverse N takes
 * its place (xi N xi = xi, N xi N = N); its twists do not turn bodies about their lines, W.line =
 * 0. For an origin on the line N is the pseudo-inverse. For any other origin the pseudo-inverse
 * would depend on the origin and on units, but N does not (docs/theory/multiblobs.md).
 *
 * Method: lift() adds friction along n before the friction is inverted or factorised; project() and
 * the remove...() methods take the contribution of this lift out of the results.
 */
class NullTwists {
public:
    /** @param rows  first row of each element in twists and wrenches */
    explicit NullTwists(const std::vector<int>& rows)
        : rows(rows), twists_body(rows.size()), partlyFixed(rows.size()) {}
    /** Look for the null twist of an element from its sites, and keep it. */
    void find(int element, const std::vector<Eigen::Vector3d>& sites);
    /**
     * Record which components of the element are fixed. If a fixed component takes part in the null
     * twist, the friction of the free components has no null twist and holds the body against
     * torques about its line. Then lift() lifts only the fixed components.
     */
    void fix(int element, const FluidElement& components);
    bool has(int element) const { return twists_body[element].size() > 0; }
    bool any() const { return hasAny; }
    /** The null twist in the body frame, of unit length; empty if the element has none. */
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
     * Remove from wrenches the component along the null twists: random wrenches made with a lifted
     * friction have one.
     */
    void removeLift(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& wrenches) const;
    /**
     * Let n_o be the part of the null twist n in fixed components. Subtract from wrenches the
     * multiple of n_o after which they do no work on n.
     */
    void removeWorkOfFixed(const std::vector<Eigen::Matrix3d>& turns,
                           Eigen::MatrixXd& wrenches) const;
    /**
     * Slips do not determine how a body turns about its line. Where a fixed component takes part in
     * this rotation, turn the body so that its twist has no component along the fixed part of the
     * null twist. Only then <U V^T> = N_c holds in free components, for the twists U = N_c K^T M^-1
     * s and the twists V nearest to the slips s of covariance M.
     */
    void turnWithFixed(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& twists) const;
    /**
     * wrenches += factor sum_k d_k (p_i n_k), with p = n_o/(n_o.n_o), n_o the fixed part of n, and
     * k over free components. With V of turnWithFixed(), the wrenches hold = K^T lambda of such
     * solves have <hold V^T> = xi N_c - 1 - p n^T in free components. The last term is not part of
     * the mean hold.
     */
    void addDivergenceOfTurns(const std::vector<Eigen::Matrix3d>& turns, double factor,
                              Eigen::MatrixXd& wrenches) const;

private:
    /**
     * Loop over the null twists of elements that are not partly fixed; and over the other null
     * twists, with their fixed part.
     */
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
 * The generalised inverse of one body's friction in its own frame.
 *
 * @param nullVector  of unit length; empty if the friction has none
 */
Eigen::MatrixXd generalisedInverse(const Eigen::MatrixXd& friction,
                                   const Eigen::VectorXd& nullVector);

}  // namespace RigidHIPlugin

#endif
