#ifndef RIGIDHI_MOST_LATTICE_ROWS_H_
#define RIGIDHI_MOST_LATTICE_ROWS_H_

namespace RigidHIPlugin {

/**
 * The number of rows of the largest matrix of lattice sums. It then takes 1.2 GB and half a minute.
 * A step needs four such matrices. Matrices of ForceCoupling along no-slip walls, whose columns are
 * products on a grid, have the same limit.
 */
const int mostLatticeRows = 12000;

}  // namespace RigidHIPlugin

#endif
