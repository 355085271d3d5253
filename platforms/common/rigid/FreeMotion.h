#ifndef RIGIDHI_FREE_MOTION_H_
#define RIGIDHI_FREE_MOTION_H_

#include <Eigen/Core>
#include <vector>

#include "rigid/FluidElement.h"

namespace RigidHIPlugin {

/**
 * Which components of twists are free, and which are fixed (at rest or prescribed;
 * FluidElement::fixed).
 *
 * Equation:  with Z_f the free components and xi the friction of all bodies,
 *            N_c = Z_f (Z_f^T xi Z_f)^-1 Z_f^T
 *            is the mobility of the free components. It differs from the free block of N, which
 * lets the fixed components move, too. Method:    Z is an orthogonal basis of twists, in which all
 * free components come first, then all fixed ones. Z is a permutation of rows; elements with
 * components fixed in their own frame are turned to their axes first.
 */
class FreeMotion {
public:
    /** @param rows  first row of each element in twists and wrenches */
    FreeMotion(const std::vector<FluidElement>& elements, const std::vector<int>& rows);
    /** Whether any component is fixed. */
    bool any() const { return numFree < (int)placeOfRow.size(); }
    int getNumFree() const { return numFree; }
    int getNumRows() const { return placeOfRow.size(); }
    /** Whether single components of an element are fixed along axes that turn with it. */
    bool turnsWithBodies() const { return hasBodyAxes; }
    /** Whether a row in the lab frame is free. With axes that turn, every row is. */
    bool isFree(int row) const { return freeInLab[row]; }

    /** x <- Z^T x, and x <- Z x. */
    void toOrdered(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& x) const;
    void fromOrdered(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& x) const;
    /**
     * xi <- Z^T xi Z.
     *
     * @param friction  its lower triangle is read; both triangles are written
     */
    void order(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& friction) const;
    /** Set the fixed components of twists or wrenches to 0. */
    void removeFixed(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& twists) const;
    /**
     * Twists whose fixed components have these values, and whose free ones are 0.
     *
     * @param values  like twists; where axes turn with the body, components along these axes
     */
    void motionOfFixed(const std::vector<Eigen::Matrix3d>& turns, const Eigen::MatrixXd& values,
                       Eigen::MatrixXd& twists) const;
    /** The inverse of motionOfFixed(): the fixed components of twists or wrenches as `values`. */
    void componentsOfFixed(const std::vector<Eigen::Matrix3d>& turns, const Eigen::MatrixXd& twists,
                           Eigen::MatrixXd& values) const;

private:
    template <class Action>
    void forBodyAxes(const std::vector<Eigen::Matrix3d>& turns, const Action& action) const;

    int numFree = 0;
    bool hasBodyAxes = false;
    std::vector<int> placeOfRow;  // of each row, in the order of Z
    std::vector<char> freeInLab, isFixed;
    struct BodyAxes {
        int element, row;
        Eigen::Matrix3d axes;
    };
    std::vector<BodyAxes> bodyAxes;
    mutable Eigen::MatrixXd scratch;
};

}  // namespace RigidHIPlugin

#endif
