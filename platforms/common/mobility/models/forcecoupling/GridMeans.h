#ifndef RIGIDHI_GRID_MEANS_H_
#define RIGIDHI_GRID_MEANS_H_

#include <Eigen/Core>
#include <complex>

#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

/**
 * The mean of a field times exp(-ik x_axis) over x, y and the heights from `low` to `high`, where k
 * is 2 pi index/(edge along the axis), nm/ps. It is exact: the field is the sum of its modes. The
 * grid must not be mirrored, and the field must be one of PlainGridFluid, with nodes in their own
 * order.
 *
 * @param axis  0 or 1
 * @param low, high  z in the coordinates of the grid, which is periodic along z
 */
Eigen::Vector3cd meanOverHeight(const GridField& field, int axis, int index, double low,
                                double high);

}  // namespace RigidHIPlugin

#endif
