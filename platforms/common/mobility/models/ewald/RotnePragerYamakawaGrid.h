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

/** What makes the walls of a grid, and the largest wave number along them that it needs. */
struct WallMaker {
    double longest = 0;
    std::function<std::shared_ptr<const GridWalls>(const EwaldSplitting& splitting)> make;
};

/**
 * Rotne-Prager-Yamakawa mobility in a periodic box, without a matrix, by pairs and waves. The
 * splitting makes both parts positive. PeriodicRotnePragerYamakawa is the same mobility as a
 * matrix, by lattice sums.
 *
 * Equation:  M = M_near + M_waves, with
 *                M_waves,ij = (1/(eta V)) sum_k D_i^+ H(k) (1 - k k/k^2) k^-2 D_j exp(i k.r_ij),
 *                D(F) = sin(ka)/(ka) F,   D(T) = (i/2) k x T 3 j_1(ka)/(ka),
 *                H(k) = (1 + k^2/4 xi^2) exp(-k^2/4 xi^2).
 *            M_near is the rest, with 1 - H. All blocks, unequal radii, overlap and images are
 *            included.
 * Method:    Waves are summed on a grid. Points spread one Gaussian, and each mode has the factor
 *            of the particles' surfaces over that of the Gaussian (GridChannel). Pairs: NearField.
 *            Both parts are symmetric to rounding. The norm of the error of products is below the
 *            tolerance times the norm of the mobility, both scaled by the square roots of own
 *            mobilities.
 *            In a triclinic box points spread Gaussians of the coordinates that follow its edges
 *            (GridSkew), for which factors make up. Such a grid has up to 1.12 times the nodes
 *            along an edge that leans by half of another one, and a sheared box has one grid.
 * Noise:     That of waves is a random field, made of numbers that belong to wave vectors. That of
 *            pairs is M_near^(1/2) W by Lanczos' method. The matrix M_near is sparse and well
 *            conditioned.
 * Cost:      Grows as the number of particles at constant density. A product takes six transforms
 *            for each radius, and six more for each radius of spheres with torque.
 * Reference: Fiore, Balboa Usabiaga, Donev, Swan, J. Chem. Phys. 146, 124116 (2017); Lindbo,
 *            Tornberg, J. Comput. Phys. 230, 8744 (2011).
 * Limits:    At most `mostRadii` different radii. The mobility is pairwise and has no lubrication
 *            near contact.
 */
class RotnePragerYamakawaGrid : public MobilityModel, BoxOfModel, GridOfModel, FieldOfModel {
public:
    /** Each radius has transforms and modes of its own. */
    static constexpr int mostRadii = 8;
    /**
     * @param tolerance  of products
     * @param spacing  of nodes, nm, at most; 0: the fastest
     * @param fluid  the grid fluid, which several models may share
     * @param walls  for fluids of ConfinedRotnePragerYamakawaGrid
     * @param stresslets  whether there are 5 more rows for each particle, after all others:
     *     stresslets and rates of strain, for StokesianDynamicsGrid. All particles are spheres
     * then.
     */
    RotnePragerYamakawaGrid(const HydrodynamicParticles& particles, double viscosity,
                            double tolerance, double spacing,
                            const std::shared_ptr<GridFluid>& fluid, const WallMaker& walls = {},
                            bool stresslets = false);
    /** Rows of forces and velocities, with those of stresslets. */
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
    /** All that depends on the box alone. */
    std::shared_ptr<const SplitBox> inBox(const BoxVectors& box) const;
    /**
     * Move these parts to a placement; null: there are none so far. If other parts are at that
     * placement already, the caller gets those parts.
     */
    void move(std::shared_ptr<SplitParts>& parts, const Placement& placement, bool nearby) const;
    /** Give parts that are in a box, at any placement. They must not be moved. */
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
    const EwaldSplitting& findSplitting(const BoxVectors& box) const;
    void takeUnshared(std::shared_ptr<SplitParts>& parts) const;
    const double tolerance, spacing;
    const WallMaker walls;
    const std::vector<EwaldKind> kinds;
    const std::shared_ptr<GridFluid> fluid;
    // The splitting, the box and the parts that were made last, for callers that ask for the same:
    // fields and products have the same placements. Results do not depend on what is kept.
    mutable std::mutex mutex;
    mutable std::unique_ptr<EwaldSplitting> lastSplitting;
    mutable BoxVectors lastBox = {};
    mutable std::shared_ptr<const SplitBox> lastInBox;
    mutable std::shared_ptr<SplitParts> kept;
};

}  // namespace RigidHIPlugin

#endif
