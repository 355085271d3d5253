#ifndef RIGIDHI_FORCE_COUPLING_GRID_H_
#define RIGIDHI_FORCE_COUPLING_GRID_H_

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "mobility/models/ewald/EwaldSplitting.h"
#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

/** The planes that confine the fluid on a grid. */
using PlanesOfGrid = std::function<std::shared_ptr<const GridPlanes>(const GridShape& shape)>;

/** The data of a triclinic box for all placements in it. */
struct ForceCouplingSkewBox {
    GridShape shape;
    double width;               // width of the Gaussian that particles spread, nm
    GridResolution resolution;  // of this Gaussian
    /** As in WaveField::setGrid(). */
    std::vector<std::unique_ptr<const GridFactors>> factors;
};

/**
 * Force coupling in a periodic box, on a grid. The cost of products and random fields is
 * proportional to the number of particles at constant density. PeriodicForceCoupling is the same
 * mobility as a matrix of lattice sums.
 *
 * Equation:  With envelopes of the widths sigma = a/sqrt(pi) and sigma_D = a/(6 sqrt(pi))^(1/3),
 *                M_ij = (1/(eta V)) sum_k D_i^+ (1 - k k/k^2) k^-2 D_j exp(i k.r_ij),
 *                D(F) = exp(-sigma^2 k^2/2) F,   D(T) = (i/2) k x T exp(-sigma_D^2 k^2/2)
 *            (Westwood 2022, eqs. 2 to 13).
 * Method:    Spread Gaussians to the nodes of a grid, transform, solve, transform back, and average
 *            with the transpose of spreading (GridFluid). The matrix is symmetric to rounding and
 *            positive semidefinite. The norm of the error of products is below the tolerance times
 *            the norm of the mobility, both scaled by the square roots of own mobilities
 *            (docs/grid_accuracy.md). In a triclinic box all particles spread one Gaussian in
 *            coordinates along its edges (GridSkew), and factors of modes correct for their
 *            envelopes.
 * Cost:      A product takes three forward and three backward transforms, and a random field takes
 *            three backward ones. In a triclinic box each radius takes as many, and its torques as
 *            many again.
 * Reference: Yeo, Maxey, J. Comput. Phys. 229, 2401 (2010); Westwood, Delmotte, Keaveny, J. Comput.
 *            Phys. 467, 111437 (2022).
 */
class ForceCouplingGrid : public MobilityModel, BoxOfModel, GridOfModel, FieldOfModel {
public:
    /**
     * @param tolerance  of products
     * @param spacing  the largest spacing of nodes, nm; 0 for the spacing that the tolerance needs
     * @param fluid  the grid fluid, which several models may share
     * @param mirrored  whether the fluid is its own reflection at y = 0, and so also in the middle
     *     of the box. This is the fluid of a slip channel in a box of twice the channel's width,
     *     with the centres of particles between these two planes.
     * @param planes  gives the planes that confine the fluid along z, for each grid; empty for none
     */
    ForceCouplingGrid(const HydrodynamicParticles& particles, double viscosity, double tolerance,
                      double spacing, const std::shared_ptr<GridFluid>& fluid,
                      bool mirrored = false, const PlanesOfGrid& planes = {});
    const BoxOfModel* box() const override { return this; }
    const GridOfModel* grid() const override { return this; }
    const FieldOfModel* randomField() const override { return this; }
    WaveFactors waveFactors(double radius, double k) const override;
    void ownMobility(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                     Eigen::MatrixXd& mobility) const override;

    const GridResolution& getResolution() const { return resolution; }
    GridShape shapeFor(const BoxVectors& box) const;
    /** Likewise without planes, because making planes takes time. */
    GridShape nodesFor(const BoxVectors& box) const;
    GridFluid& getFluid() const { return *fluid; }
    const std::vector<EwaldKind>& getKinds() const { return kinds; }
    /** The data of a triclinic box; null in a box with edges along the axes. */
    std::shared_ptr<const ForceCouplingSkewBox> skewBox(const BoxVectors& box) const;

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
    bool isLocal() const override { return true; }
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
              std::unique_ptr<RandomField>& field) const override;
    const GridResolution resolution;
    const std::shared_ptr<GridFluid> fluid;
    const PlanesOfGrid planes;
    const std::vector<EwaldKind> kinds;
    // The last skew box, for callers that need the same one.
    mutable std::mutex mutex;
    mutable BoxVectors lastBox = {};
    mutable std::shared_ptr<const ForceCouplingSkewBox> lastSkewBox;
};

}  // namespace RigidHIPlugin

#endif
