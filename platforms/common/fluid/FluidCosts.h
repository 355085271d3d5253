#ifndef RIGIDHI_FLUID_COSTS_H_
#define RIGIDHI_FLUID_COSTS_H_

#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

/** The costs of the mobilities of a Context so far, earlier fluids of the Context included. */
class FluidCosts {
public:
    explicit FluidCosts(const FluidContents& fluid) : fluid(fluid) {}
    /** The number of products with mobilities and of formed matrices. */
    long long getNumProducts() const;
    /** Times of the grid. */
    GridSeconds getGridSeconds() const;
    /** The time of Krylov methods without their products. */
    double getSecondsOfSolver() const;
    /** Add the costs of an earlier fluid of this Context. */
    void continueFrom(const FluidCosts& before);

private:
    MobilityCosts ownCosts() const;
    const FluidContents& fluid;
    // Of the fluids before this one:
    long long productsBefore = 0;
    GridSeconds gridSecondsBefore;
    double secondsOfSolverBefore = 0;
};

}  // namespace RigidHIPlugin

#endif
