#ifndef RIGIDHI_PLANE_MATRICES_H_
#define RIGIDHI_PLANE_MATRICES_H_

#include "mobility/models/confined/PlaneConditions.h"

// Decompositions of the small symmetric matrices of planes, in one file because they take long to
// compile. Eigenvalues have the digits of doubles.

namespace RigidHIPlugin {

/** The principal root of a symmetric matrix that is positive semidefinite except for rounding. */
PlaneConditions::Matrix principalRoot(const PlaneConditions::Matrix& square);

/** A root, root root^T = square, of a matrix that is positive semidefinite except for rounding. */
PlaneConditions::Matrix rootOf(const PlaneConditions::Matrix& square);

PlaneConditions::Matrix inverseOf(const PlaneConditions::Matrix& matrix);

/** L^-T of L L^T = square. */
PlaneConditions::Matrix inverseFactorOf(const PlaneConditions::Matrix& square);

}  // namespace RigidHIPlugin

#endif
