#include "rigid/FreeMotion.h"

#include <algorithm>

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

FreeMotion::FreeMotion(const vector<FluidElement>& elements, const vector<int>& rows) {
    int numRows = 0;
    for (const FluidElement& element : elements) numRows += element.numRows();
    freeInLab.assign(numRows, true);
    isFixed.assign(numRows, false);
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const bool hasAxes = element.fixedInBody && !element.isWhollyFree() && !element.isHeld;
        if (hasAxes) bodyAxes.push_back({(int)e, rows[e], element.axes});
        const bool partly = hasAxes && !element.isWhollyFixed();
        hasBodyAxes = hasBodyAxes || partly;
        for (int k = 0; k < element.numRows(); k++) {
            isFixed[rows[e] + k] = element.isFixed(k);
            freeInLab[rows[e] + k] = partly || !element.isFixed(k);
        }
    }
    placeOfRow.resize(numRows);
    numFree = count(isFixed.begin(), isFixed.end(), false);
    int nextFree = 0, nextFixed = numFree;
    for (int row = 0; row < numRows; row++)
        placeOfRow[row] = isFixed[row] ? nextFixed++ : nextFree++;
}

/**
 * Call action(row, turn from the element's axes to the lab) for each element with axes of its own.
 */
template <class Action>
void FreeMotion::forBodyAxes(const vector<Matrix3d>& turns, const Action& action) const {
    for (const BodyAxes& own : bodyAxes) {
        const Matrix3d toLab = turns[own.element] * own.axes;
        for (int part = 0; part < 6; part += 3) action(own.row + part, toLab);
    }
}

void FreeMotion::toOrdered(const vector<Matrix3d>& turns, MatrixXd& x) const {
    forBodyAxes(turns, [&](int row, const Matrix3d& toLab) {
        x.middleRows<3>(row) = (toLab.transpose() * x.middleRows<3>(row)).eval();
    });
    scratch.resize(x.rows(), x.cols());
    for (int row = 0; row < x.rows(); row++) scratch.row(placeOfRow[row]) = x.row(row);
    x.swap(scratch);
}

void FreeMotion::fromOrdered(const vector<Matrix3d>& turns, MatrixXd& x) const {
    scratch.resize(x.rows(), x.cols());
    for (int row = 0; row < x.rows(); row++) scratch.row(row) = x.row(placeOfRow[row]);
    x.swap(scratch);
    forBodyAxes(turns, [&](int row, const Matrix3d& toLab) {
        x.middleRows<3>(row) = (toLab * x.middleRows<3>(row)).eval();
    });
}

void FreeMotion::order(const vector<Matrix3d>& turns, MatrixXd& friction) const {
    friction.triangularView<StrictlyUpper>() = friction.transpose();
    toOrdered(turns, friction);
    friction.transposeInPlace();
    toOrdered(turns, friction);
}

void FreeMotion::removeFixed(const vector<Matrix3d>& turns, MatrixXd& twists) const {
    if (!any()) return;
    toOrdered(turns, twists);
    twists.bottomRows(getNumRows() - numFree).setZero();
    fromOrdered(turns, twists);
}

void FreeMotion::motionOfFixed(const vector<Matrix3d>& turns, const MatrixXd& values,
                               MatrixXd& twists) const {
    twists.setZero(values.rows(), values.cols());
    for (int row = 0; row < values.rows(); row++)
        if (isFixed[row]) twists.row(row) = values.row(row);
    forBodyAxes(turns, [&](int row, const Matrix3d& toLab) {
        twists.middleRows<3>(row) = (toLab * twists.middleRows<3>(row)).eval();
    });
}

void FreeMotion::componentsOfFixed(const vector<Matrix3d>& turns, const MatrixXd& twists,
                                   MatrixXd& values) const {
    values = twists;
    forBodyAxes(turns, [&](int row, const Matrix3d& toLab) {
        values.middleRows<3>(row) = (toLab.transpose() * values.middleRows<3>(row)).eval();
    });
    for (int row = 0; row < values.rows(); row++)
        if (!isFixed[row]) values.row(row).setZero();
}

}  // namespace RigidHIPlugin
