#ifndef RIGIDHI_MOST_LATTICE_ROWS_H_
#define RIGIDHI_MOST_LATTICE_ROWS_H_

namespace RigidHIPlugin {

/**
 * The largest matrix of lattice sums. With so many rows it has 1.2 GB and is made in half a minute.
 * A step needs four such matrices.
 */
const int mostLatticeRows = 12000;

}  // namespace RigidHIPlugin

#endif
