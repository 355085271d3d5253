#ifndef RIGIDHI_GRID_CHOICE_H_
#define RIGIDHI_GRID_CHOICE_H_

#include <string>

#include "mobility/MobilityModel.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * Whether the particles of a periodic fluid are done by matrices of lattice sums or on a grid.
 *
 * With setSolver(Auto) the choice is that of the smaller time of a step, by a model of both times.
 * The constants of this model were measured once (benchmarks/README.md). No clock is used, so the
 * choice is a function of radii, settings, scheme and the System's default box, and a resumed run
 * chooses the same. Matrices are exact and take any box, so few particles keep them in any case.
 */
struct GridChoice {
    bool onGrid = false;
    double matrixSeconds = 0, gridSeconds = 0;  // of a step on one thread; 0: not estimated

    bool isEstimated() const { return gridSeconds > 0; }
    /** What matrices of a confined fluid cost; empty: there are none, or the box is not known. */
    std::string costOfMatrices;
    /** The choice and its reason or its cost, for describeEffects(); empty if nothing was
     * estimated. */
    std::string text() const;
};

/**
 * The choice for RotnePragerYamakawa and ForceCoupling with periodic boundaries. StokesianDynamics
 * has a grid where MatrixFree asks for it. Other models and boundaries have no grid, and get none.
 * ForceCoupling beside no-slip walls has a grid and no lattice sums. Its matrices are made of
 * products with the columns of the identity, which Auto takes for very few rows.
 *
 * The numbers of rows alone decide where nobody has set the System's default box, so that it is
 * OpenMM's own, and where setGridSpacing() asks for a grid.
 */
GridChoice chooseGrid(const MobilityForce& force, CustomRigidHIIntegrator::Scheme scheme,
                      const BoxVectors& defaultBox, const HydrodynamicParticles& particles);

}  // namespace RigidHIPlugin

#endif
