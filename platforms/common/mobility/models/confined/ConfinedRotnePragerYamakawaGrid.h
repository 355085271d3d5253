#ifndef RIGIDHI_CONFINED_ROTNE_PRAGER_YAMAKAWA_GRID_H_
#define RIGIDHI_CONFINED_ROTNE_PRAGER_YAMAKAWA_GRID_H_

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "mobility/models/confined/ConfiningPlanes.h"
#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility above a no-slip wall or between two walls, periodic along the
 * walls, without a matrix: pairs and waves in a box of the period P along z, and the flows that
 * correct for walls and for the period (GridWalls). ConfinedRotnePragerYamakawa is the same
 * mobility as a matrix.
 *
 * Method:    The base is RotnePragerYamakawaGrid in a box that is higher than the fluid by the
 *            reach of stencils beyond the walls. Walls are not split: the grid carries all of their
 *            waves, up to k with (1 + 2kz)^2 exp(-2kz) = tolerance for the particle nearest to a
 *            wall, at the distance z, and this k determines xi. The distance counts in steps, and
 *            so does the top of the box above one wall, which follows the highest particle. Except
 *            within the tolerance, results depend on neither.
 * Accuracy:  That of the base: the norm of the error of products is below the tolerance times the
 *            norm of the mobility, both scaled by the square roots of own mobilities.
 * Noise:     A random field of waves with planes, and for pairs alone a square root by Lanczos'
 *            method, conditional on a flow of 0 on the planes (ConfinedRandomField).
 * Cost:      Proportional to the number of particles at constant density and height. A product
 *            takes the transforms of the base, and another pass over its modes.
 * Limits:    Boxes with edges along the axes; at most RotnePragerYamakawaGrid::mostRadii radii.
 *            Where surfaces reach through a wall, M -> B M B (NoSlipPlane).
 */
class ConfinedRotnePragerYamakawaGrid : public MobilityModel,
                                        BoxOfModel,
                                        GridOfModel,
                                        FieldOfModel {
public:
    /**
     * @param tolerance, spacing, fluid  as in RotnePragerYamakawaGrid
     * @throws OpenMMException if radii do not fit between the walls
     */
    ConfinedRotnePragerYamakawaGrid(const HydrodynamicParticles& particles, double viscosity,
                                    double tolerance, double spacing, const ConfiningPlanes& planes,
                                    const std::shared_ptr<GridFluid>& fluid);
    const ConfiningPlanes& getPlanes() const { return planes; }
    std::string objection(const Placement& placement) const override {
        return planes.objection(particles, placement);
    }
    bool acceptsNearby(const Placement& placement) const override;
    OpenMM::Vec3 placeInFormulas(int i, const OpenMM::Vec3& position) const override {
        return planes.placeInFormulas(position, particles.radii[i]);
    }
    double weightInFormulas(int i, const OpenMM::Vec3& position) const override {
        return planes.allowsCrossing() ? planes.weight(position[2], particles.radii[i]) : 1;
    }
    WaveFactors waveFactors(double radius, double k) const override;
    const BoxOfModel* box() const override { return this; }
    const GridOfModel* grid() const override { return this; }
    const FieldOfModel* randomField() const override { return this; }
    double getTolerance() const { return tolerance; }

    /**
     * The base of a fluid up to a height above the lower wall, for particles whose centres are not
     * nearer to a wall than a distance.
     */
    struct Base {
        std::shared_ptr<const RotnePragerYamakawaGrid> model;
        double height = 0, nearest = 0, period = 0;
        double longest = 0;  // wave number along the walls
        BoxVectors box = {};
    };
    /**
     * The base for a box and particles whose surfaces reach up to a height.
     *
     * @param nearest  the smallest distance of a centre from a wall; 0 for contact
     */
    Base baseFor(const BoxVectors& box, double top, double nearest = 0) const;
    /**
     * Whether a base is for particles that reach up to a height and this near to a wall.
     *
     * @param beyond  by how much they may exceed it, relative
     */
    bool holds(const Base& base, double top, double nearest, double beyond) const;
    /** Particles as the formulas need them: moved to contact where they reach through a wall. */
    struct Lifted {
        std::vector<OpenMM::Vec3> positions;
        Eigen::VectorXd weights;  // B for each row; empty if no particle reaches through a wall
        double top = 0;           // height above the lower wall up to which surfaces reach
        double nearest = 0;       // the smallest distance of a centre from a wall
    };
    /**
     * @param nearby  whether the placement is a small displacement from an accepted one; its
     *     positions then stay unchanged
     */
    void lift(const Placement& placement, bool nearby, Lifted& lifted) const;
    /** The largest wave number along walls that the grid has for particles at contact. */
    double getLongestWave() const { return longest; }
    void check(const BoxVectors& box) const override;
    /**
     * The splitting of the base for particles up to a height above the lower wall.
     *
     * @param period   set to the period of the base
     * @param nearest  the smallest distance of a centre from a wall; 0 for contact
     */
    static EwaldSplitting splittingFor(const HydrodynamicParticles& particles, double tolerance,
                                       double spacing, const BoxVectors& box, double height,
                                       double& period, double nearest = 0);

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    double volume(const BoxVectors& box) const override;
    void checkWave(const BoxVectors& box, int axis, int periods) const override;
    std::string describe(const BoxVectors& box) const override;
    GridSeconds getSeconds() const override { return fluid->getSeconds(); }
    double topFor(double top) const;
    double nearestFor(double nearest) const;
    bool isLocal() const override { return false; }
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
              std::unique_ptr<RandomField>& field) const override;

    const double tolerance, spacing;
    const ConfiningPlanes planes;
    const std::shared_ptr<GridFluid> fluid;
    double smallest = 0, longest = 0;
    /** The last bases. */
    mutable std::mutex mutex;
    mutable std::vector<Base> bases;
};

}  // namespace RigidHIPlugin

#endif
