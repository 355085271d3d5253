#ifndef RIGIDHI_GRID_CHOICE_H_
#define RIGIDHI_GRID_CHOICE_H_

#include <string>

#include "mobility/MobilityModel.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * Seconds of a step's matrices, on one thread, where each of their columns is a product on a grid;
 * 0: not estimated.
 */
struct ColumnSeconds {
    double withoutNoise = 0, withNoise = 0;  // noise comes with a drift, which takes matrices too
};

/**
 * Whether the mobility of a periodic fluid comes from matrices of lattice sums or from a grid.
 *
 * setSolver(Auto) takes the one with the smaller time of a step, by a model of both times. The
 * constants of this model were measured once (benchmarks/README.md). The choice uses no clock: it
 * is a function of radii, settings, scheme and the System's default box, and a resumed run makes
 * the same choice. Along no-slip walls the third vector of that box has no effect. Matrices are
 * exact and allow any box, so small sets of particles keep them unless they are far slower.
 */
struct GridChoice {
    bool onGrid = false;
    bool isSmall = false;  // few rows: matrices, where they are not much slower
    double matrixSeconds = 0, gridSeconds = 0;  // of a step on one thread; 0: not estimated

    ColumnSeconds columns;  // with lubrication, of a model without lattice sums

    bool isEstimated() const { return gridSeconds > 0; }
    /**
     * The cost of the matrices of a confined fluid; empty without matrices or without a known box.
     */
    std::string costOfMatrices;
    /** The choice and its reason or its cost, for describeEffects(); empty without an estimate. */
    std::string text() const;
};

/**
 * The choice for RotnePragerYamakawa and ForceCoupling with periodic boundaries. StokesianDynamics
 * uses a grid only with setSolver(MatrixFree). Other models and boundaries have no grid.
 * ForceCoupling beside no-slip walls has a grid and no lattice sums. The columns of its matrices
 * are products on the grid with the columns of the identity; Auto takes such matrices for very few
 * rows.
 *
 * The number of rows alone decides in two cases: where the System still has OpenMM's default box,
 * and where setGridSpacing() asks for a grid.
 */
GridChoice chooseGrid(const MobilityForce& force, CustomRigidHIIntegrator::Scheme scheme,
                      const BoxVectors& defaultBox, const HydrodynamicParticles& particles);

}  // namespace RigidHIPlugin

#endif
