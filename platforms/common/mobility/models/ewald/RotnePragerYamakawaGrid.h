#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_GRID_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_GRID_H_

#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "mobility/models/ewald/SplitBox.h"
#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

class SplitParts;

/**
 * A function that makes the walls of a grid, the largest wave number along the walls that it needs,
 * and the bytes that walls need.
 */
struct WallMaker {
    double longest = 0, bytes = 0;
    std::function<std::shared_ptr<const GridWalls>(const EwaldSplitting& splitting)> make;
};

/**
 * Rotne-Prager-Yamakawa mobility in a periodic box, without a matrix, as a sum of pairs and waves.
 * Both parts are positive. PeriodicRotnePragerYamakawa is the same mobility as a matrix of lattice
 * sums.
 *
 * Equation:  M = M_near + M_waves, with
 *                M_waves,ij = (1/(eta V)) sum_k D_i^+ H(k) (1 - k k/k^2) k^-2 D_j exp(i k.r_ij),
 *                D(F) = sin(ka)/(ka) F,   D(T) = (i/2) k x T 3 j_1(ka)/(ka),
 *                H(k) = (1 + k^2/4 xi^2) exp(-k^2/4 xi^2).
 *            M_near is the rest, with 1 - H. The mobility includes all blocks, unequal radii,
 *            overlap and images.
 * Method:    A grid sums the waves. Points spread one Gaussian, and each mode has the factor of the
 *            particles' surfaces over that of the Gaussian (GridChannel). Pairs: NearField. Both
 *            parts are symmetric to rounding. The norm of the error of products is below the
 *            tolerance times the norm of the mobility, both scaled by the square roots of own
 *            mobilities. In a triclinic box points spread Gaussians in coordinates along its edges
 *            (GridSkew), and the factors correct for this. Such a grid has up to 1.12 times the
 *            nodes along an edge tilted by half of another edge, and a sheared box keeps one grid.
 * Noise:     The noise of waves is a random field, made of numbers that belong to wave vectors. The
 *            noise of pairs is M_near^(1/2) W by Lanczos' method. The matrix M_near is sparse and
 *            well conditioned.
 * Cost:      Proportional to the number of particles at constant density. A product takes six
 *            transforms for each radius, and six more for each radius of spheres with torque.
 * Reference: Fiore, Balboa Usabiaga, Donev, Swan, J. Chem. Phys. 146, 124116 (2017); Lindbo,
 *            Tornberg, J. Comput. Phys. 230, 8744 (2011).
 * Limits:    At most `mostRadii` different radii. The mobility is pairwise and has no lubrication
 *            near contact.
 */
class RotnePragerYamakawaGrid : public MobilityModel, BoxOfModel, GridOfModel, FieldOfModel {
public:
    /** Each radius has its own transforms and modes. */
    static constexpr int mostRadii = 8;
    /**
     * @param tolerance  of products
     * @param spacing  the largest spacing of nodes, nm; 0 for the fastest
     * @param fluid  the grid fluid, which several models may share
     * @param walls  for the fluids of ConfinedRotnePragerYamakawaGrid
     * @param stresslets  whether each particle has 5 more rows, after all others: stresslets and
     *     strain rates, for StokesianDynamicsGrid. All particles are then spheres.
     */
    RotnePragerYamakawaGrid(const HydrodynamicParticles& particles, double viscosity,
                            double tolerance, double spacing,
                            const std::shared_ptr<GridFluid>& fluid, const WallMaker& walls = {},
                            bool stresslets = false);
    /** The number of rows of forces and velocities, including stresslets. */
    int getNumRows() const {
        return particles.numRows + (haveStresslets(kinds) ? 5 * particles.size() : 0);
    }
    /** For each row, the root of a particle's own friction over 6 pi viscosity. */
    Eigen::VectorXd rootsOfOwn() const {
        return rootsOfOwnFriction(particles, haveStresslets(kinds));
    }
    const BoxOfModel* box() const override { return this; }
    const GridOfModel* grid() const override { return this; }
    const FieldOfModel* randomField() const override { return this; }
    WaveFactors waveFactors(double radius, double k) const override;

    const std::vector<EwaldKind>& getKinds() const { return kinds; }
    double getTolerance() const { return tolerance; }
    /** The splitting for a box, which depends on nothing else. */
    EwaldSplitting splittingFor(const BoxVectors& box) const;
    /** The data that depend on the box alone. */
    std::shared_ptr<const SplitBox> inBox(const BoxVectors& box) const;
    /**
     * Move these parts to a placement; a null pointer gets new parts. If other parts are already at
     * that placement, the caller gets those parts.
     */
    void move(std::shared_ptr<SplitParts>& parts, const Placement& placement, bool nearby) const;
    /** Give parts in a box, at any placement. The caller must not move them. */
    void setBox(std::shared_ptr<SplitParts>& parts,
                const std::shared_ptr<const SplitBox>& box) const;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    void check(const BoxVectors& box) const override;
    double volume(const BoxVectors& box) const override {
        return box[0][0] * box[1][1] * box[2][2];
    }
    void checkWave(const BoxVectors& box, int axis, int periods) const override;
    std::string describe(const BoxVectors& box) const override;
    GridSeconds getSeconds() const override { return fluid->getSeconds(); }
    bool isLocal() const override { return false; }
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
              std::unique_ptr<RandomField>& field) const override;
    const EwaldSplitting& findSplitting(const BoxVectors& box, bool withWalls = true) const;
    void takeUnshared(std::shared_ptr<SplitParts>& parts) const;
    const double tolerance, spacing;
    const WallMaker walls;
    const std::vector<EwaldKind> kinds;
    const std::shared_ptr<GridFluid> fluid;
    // The last splitting, box and parts, for callers that need the same: fields and products have
    // the same placements. Results do not depend on this storage.
    mutable std::mutex mutex;
    mutable std::unique_ptr<EwaldSplitting> lastSplitting;
    mutable BoxVectors lastBox = {};
    mutable std::shared_ptr<const SplitBox> lastInBox;
    mutable std::shared_ptr<SplitParts> kept;
};

}  // namespace RigidHIPlugin

#endif
