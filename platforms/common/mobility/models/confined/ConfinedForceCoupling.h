#ifndef RIGIDHI_CONFINED_FORCE_COUPLING_H_
#define RIGIDHI_CONFINED_FORCE_COUPLING_H_

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "mobility/models/confined/ConfiningPlanes.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"

namespace RigidHIPlugin {

class PlaneConditions;

/**
 * Force coupling above a no-slip wall, between two walls, or in a film on a wall, periodic along
 * the planes, on a grid. Random velocities are exact and cost as much as in a periodic fluid.
 *
 * Equation:  M_ij = D_i^+ G' D_j, with the envelopes of ForceCouplingGrid and the response G' of a
 *            fluid that is periodic along all axes and confined by planes z = const
 *            (PlaneConditions). The matrix is positive semidefinite wherever particles are, because
 *            it is a Gram matrix.
 * Period:    Envelopes reach a little beyond a wall, so the definition includes the fluid there:
 *            with the largest radius a, the period is the height plus a gap of 2 a. A PeriodicWall
 *            has another plane at rest 1.5 a below the wall, and velocities at some height above
 *            all envelopes have the law of a fluid that is unbounded there. The result depends
 *            neither on that height nor on the gap above it.
 * Mean flow: Planes balance all forces along them. The mean pressure gradient along a NoSlipChannel
 *            or a Film is zero. With ZeroFlux the flux along a NoSlipChannel is zero instead.
 * Accuracy:  that of ForceCouplingGrid. Nodes are closer to each other along z, because on a plane
 *            only one envelope takes part in an error.
 * Cost:      three forward and three backward transforms, and for each wave vector along the planes
 *            a product with a matrix of 6 or 9 rows.
 * Limits:    Boxes with edges along the axes. Rounding errors grow with the ratio of an edge to the
 *            height of the fluid. They were 1e-13 at the ratio 1280; a grid has at most 8190 nodes
 *            along an edge.
 * Reference: docs/theory/walls.md
 */
class ConfinedForceCoupling : public MobilityModel, BoxOfModel, GridOfModel, FieldOfModel {
public:
    /**
     * @param tolerance, spacing, fluid  as for ForceCouplingGrid
     * @param byProducts  whether to avoid matrices; otherwise a matrix takes one product for each
     *     column
     * @throws OpenMMException for more rows than a matrix may have, or radii that do not fit
     */
    ConfinedForceCoupling(const HydrodynamicParticles& particles, double viscosity,
                          const ConfiningPlanes& planes, double tolerance, double spacing,
                          const std::shared_ptr<GridFluid>& fluid, bool byProducts = true);
    ~ConfinedForceCoupling() override;
    /** How far the next plane is behind a wall, nm. */
    static double behindWalls(const HydrodynamicParticles& particles,
                              MobilityForce::Boundary boundary);
    /** How much longer than the height of the fluid the period of the grid is, nm. */
    static double beyondHeight(const HydrodynamicParticles& particles,
                               MobilityForce::Boundary boundary);

    std::string objection(const Placement& placement) const override {
        return planes.objection(particles, placement);
    }
    /** The matrix exists beyond contact, too. */
    bool acceptsNearby(const Placement& placement) const override {
        return planes.areWithin(particles, placement, 1);
    }
    WaveFactors waveFactors(double radius, double k) const override;
    const BoxOfModel* box() const override { return this; }
    const GridOfModel* grid() const override { return this; }
    const FieldOfModel* randomField() const override { return this; }
    void ownMobility(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                     Eigen::MatrixXd& mobility) const override {
        onGrid.ownMobility(body, sites, mobility);
    }

    /** The model in the periodic box. */
    const ForceCouplingGrid& inPeriodicBox() const { return onGrid; }
    /** The period of a grid that is high enough for particles at these positions. */
    double periodFor(const std::vector<OpenMM::Vec3>& positions) const;
    /** Whether a grid of this period is high enough. */
    bool holds(double period, const std::vector<OpenMM::Vec3>& positions) const;
    /**
     * The same placement in the periodic box.
     *
     * @throws OpenMMException as BoxOfModel::check()
     */
    void toPeriodic(const Placement& placement, double period, Placement& inPeriodic) const;
    std::vector<OpenMM::Vec3> inPeriodic(const std::vector<OpenMM::Vec3>& points) const;
    double inPeriodic(double z) const { return z - planes.getLow() - origin; }
    /** z of the highest point of the fluid on a grid of this period. */
    double topOf(double period) const;
    const ConfiningPlanes& getPlanes() const { return planes; }
    /**
     * Whether products in single precision have an error of at most
     * Accuracy::errorOfSinglePrecision. The error grows as the square of the edges over the
     * distance of the nearest two planes, and was 2e-6 at a ratio of 100.
     */
    bool mayRound(const BoxVectors& box) const;
    static constexpr double flattestInSingle = 50;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    void check(const BoxVectors& box) const override { check(box, periodFor({})); }
    void check(const BoxVectors& box, double period) const;
    double volume(const BoxVectors& box) const override;
    void checkWave(const BoxVectors& box, int axis, int periods) const override;
    std::string describe(const BoxVectors& box) const override;
    GridSeconds getSeconds() const override {
        return static_cast<const MobilityModel&>(onGrid).grid()->getSeconds();
    }
    bool isLocal() const override { return true; }
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
              std::unique_ptr<RandomField>& field) const override;
    PlaneConditions conditionsOf(double period) const;
    std::shared_ptr<const GridPlanes> planesOf(const GridShape& shape) const;
    BoxVectors periodicBox(const BoxVectors& box, double period) const;

    const ConfiningPlanes planes;
    double gap, below, origin;
    const ForceCouplingGrid onGrid;
    // The planes of the last grids. A grid above a wall changes with the heights of particles.
    struct Made;
    mutable std::mutex madeMutex;
    mutable std::vector<Made> made;
};

}  // namespace RigidHIPlugin

#endif
