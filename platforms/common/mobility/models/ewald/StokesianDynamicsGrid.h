#ifndef RIGIDHI_STOKESIAN_DYNAMICS_GRID_H_
#define RIGIDHI_STOKESIAN_DYNAMICS_GRID_H_

#include <memory>
#include <string>

#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"
#include "mobility/models/lubricated/Lubrication.h"
#include "mobility/models/stokesian/StokesianDynamics.h"

namespace RigidHIPlugin {

/**
 * Rigid spheres in a periodic box, without matrices: PeriodicStokesianDynamics as a sum of pairs
 * and waves.
 *
 * Equation:  M (f, S) = B U - E and f + Delta U = F + Delta_FE E, with the matrix M of forces,
 *            torques and stresslets of RotnePragerYamakawaGrid, U relative to a driven flow with
 *            the strain rates E at the spheres, and Delta of Lubrication. B puts U into the first
 *            rows, and 0 into those of strain rates.
 * Method:    GMRES for (U, S), with f = F - Delta U. Its preconditioner takes parts of own
 *            mobilities for M (ofMotion and ofStresslets in the source), with an incomplete
 *            Cholesky factor of their inverse plus Delta of pairs nearer than 2.5 mean radii. An
 *            iteration takes one product with M.
 * Noise:     U = N (B^T M^-1 v + Delta^1/2 W): slips v with the covariance M from the random field
 *            of RotnePragerYamakawaGrid, and forces that belong to pairs (NearAndFar).
 * Accuracy:  Velocities are accurate to the tolerance. Except for the reach of lubrication, the
 *            model is that of PeriodicStokesianDynamics.
 * Cost:      About ten to forty products for each solve; each product takes twelve transforms for
 *            each radius. Proportional to the number of spheres at constant density.
 * Limits:    Those of StokesianDynamics and RotnePragerYamakawaGrid. No minimum gap, because the
 *            far field of overlapping spheres has no closed form.
 */
class StokesianDynamicsGrid : public StokesianDynamics {
public:
    /**
     * @param tolerance  of velocities
     * @param spacing  the largest spacing of nodes, nm; 0 for the fastest
     * @param fluid  the grid fluid, which several models may share
     */
    StokesianDynamicsGrid(const HydrodynamicParticles& particles, double viscosity,
                          bool lubrication, double tolerance, double spacing,
                          const LubricationReach& reach, const std::shared_ptr<GridFluid>& fluid);
    /** In mean radii. A longer reach would have too many pairs. */
    static constexpr LubricationReach reachByDefault = {3, 4};
    std::string objection(const Placement& placement) const override;
    std::string describeLubrication() const override {
        return hasLubrication() ? pairs.describe() : std::string();
    }
    WaveFactors waveFactors(double radius, double k) const override {
        return farField.waveFactors(radius, k);
    }
    const BoxOfModel* box() const override { return farField.box(); }
    const GridOfModel* grid() const override { return farField.grid(); }
    /** The random field of M, with its rows of stresslets. */
    const FieldOfModel* randomField() const override { return farField.randomField(); }

    const RotnePragerYamakawaGrid& getFarField() const { return farField; }
    const Lubrication& getPairs() const { return pairs; }

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    const RotnePragerYamakawaGrid farField;
    const Lubrication pairs;
};

}  // namespace RigidHIPlugin

#endif
