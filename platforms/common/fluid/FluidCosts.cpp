#include "fluid/FluidCosts.h"

namespace RigidHIPlugin {

MobilityCosts FluidCosts::ownCosts() const {
    MobilityCosts sum;
    for (const auto& group : fluid.groups) {
        sum.add(group->mobilities.getCosts());
        sum.add(group->brownian->getCostsOfSlowed());
    }
    return sum;
}

long long FluidCosts::getNumProducts() const {
    const MobilityCosts own = ownCosts();
    return productsBefore + own.products + own.matrices;
}

GridSeconds FluidCosts::getGridSeconds() const {
    // Models of several groups share a grid, and each reports the grid's times.
    GridSeconds seconds;
    for (const auto& group : fluid.groups)
        if (const GridOfModel* grid = group->grid()) seconds.raise(grid->getSeconds());
    seconds.add(gridSecondsBefore);
    return seconds;
}

double FluidCosts::getSecondsOfSolver() const {
    return secondsOfSolverBefore + ownCosts().secondsOfSolver;
}

void FluidCosts::continueFrom(const FluidCosts& before) {
    productsBefore = before.getNumProducts();
    // Both fluids may share a grid, whose times this fluid already counts.
    gridSecondsBefore = {};
    const GridSeconds own = getGridSeconds();
    gridSecondsBefore = before.getGridSeconds();
    gridSecondsBefore.add(own, -1);
    secondsOfSolverBefore = before.getSecondsOfSolver();
}

}  // namespace RigidHIPlugin
