#include "mobility/models/confined/ConfinedRotnePragerYamakawaGrid.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "mobility/models/confined/ConfinedRandomField.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"
#include "mobility/models/confined/NearPlanes.h"
#include "mobility/models/confined/WallModes.h"
#include "mobility/models/ewald/NearPair.h"
#include "mobility/models/forcecoupling/GridChecks.h"
#include "mobility/models/forcecoupling/GridWalls.h"
#include "mobility/models/periodic/MostLatticeRows.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using OpenMM::Vec3;

namespace {

/**
 * The tolerance for pairs and waves of the base and for waves of walls. Measurements show that with
 * this part of the whole tolerance the total error is below the tolerance, also at contact with
 * walls (docs/grid_accuracy.md).
 */
double toleranceOfBase(double tolerance) {
    return 0.4 * std::pow(std::min(1.0, tolerance / 1e-4), 0.17) * tolerance;
}

/** The largest wave number along walls that the tolerance needs for particles at a distance. */
double longestWave(double nearest, double tolerance) {
    return depthOfModes(toleranceOfBase(tolerance)) / nearest;
}

/** Heights and distances grow in steps of this factor, so that the grid rarely changes. */
const double stepOfHeights = 1.25;

class ConfinedOnGrid : public MobilityAt {
public:
    explicit ConfinedOnGrid(const ConfinedRotnePragerYamakawaGrid& model)
        : MobilityAt(model), model(model), planes(model.getPlanes()) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override {
        const MatrixXd* of = &forces;
        if (lifted.weights.size() > 0) {
            scaled = lifted.weights.asDiagonal() * forces;
            of = &scaled;
        }
        inBase->multiply(*of, velocities);
        addUniformPart(*of, velocities);
        if (lifted.weights.size() > 0) velocities = lifted.weights.asDiagonal() * velocities;
    }
    /** By lattice sums, which take less time than a product for each column. */
    void dense(MatrixXd& mobility) override {
        if (particles.numRows > mostLatticeRows) {
            MobilityAt::dense(mobility);
            return;
        }
        const ConfinedRotnePragerYamakawa bySums(particles, viscosity, planes);
        std::unique_ptr<MobilityAt> at;
        if (isNearby)
            bySums.placeNear(at, here);
        else
            bySums.place(at, here);
        at->dense(mobility);
    }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        MatrixXd forces = sources.forces;
        if (lifted.weights.size() > 0) forces = lifted.weights.asDiagonal() * sources.forces;
        addConfinedFlow(planes, particles, lifted.positions, box, forces, points,
                        factor / viscosity, velocities);
    }
    double getSecondsOfGrid() const override { return inBase ? inBase->getSecondsOfGrid() : 0; }

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    void addUniformPart(const MatrixXd& forces, MatrixXd& velocities) const;

    const ConfinedRotnePragerYamakawaGrid& model;
    const ConfiningPlanes& planes;
    ConfinedRotnePragerYamakawaGrid::Base base;
    BoxVectors box = {};
    ConfinedRotnePragerYamakawaGrid::Lifted lifted;
    Placement here, place;
    bool isNearby = false;
    std::unique_ptr<MobilityAt> inBase;
    MatrixXd scaled;
};

void ConfinedOnGrid::moveTo(const Placement& placement, bool nearby) {
    model.check(placement.box);
    box = placement.box;
    here = placement;
    isNearby = nearby;
    model.lift(placement, nearby, lifted);
    // For a small displacement from an accepted placement, everything but the positions stays the
    // same.
    const ConfinedRotnePragerYamakawaGrid::Base before = base;
    if (!nearby || !inBase) base = model.baseFor(box, lifted.top, lifted.nearest);
    if (base.model != before.model) inBase.reset();
    place.box = {box[0], box[1], Vec3(0, 0, base.period)};
    place.positions = lifted.positions;
    for (Vec3& x : place.positions) x[2] -= planes.getLow() + 0.5 * base.height;
    if (nearby)
        base.model->placeNear(inBase, place);
    else
        base.model->place(inBase, place);
}

/** Add UniformFlow of all pairs, as a sum of products. */
void ConfinedOnGrid::addUniformPart(const MatrixXd& forces, MatrixXd& velocities) const {
    const Eigen::Matrix3d factors =
        UniformFlow(planes, base.period).getCoefficients() / (viscosity * planeArea(box));
    for (int c = 0; c < forces.cols(); c++)
        for (int axis = 0; axis < 2; axis++) {
            const int turn = 4 - axis, sign = axis == 0 ? 1 : -1;
            Eigen::Vector3d sums = Eigen::Vector3d::Zero();
            for (int i = 0; i < particles.size(); i++) {
                const auto felt =
                    UniformFlow::felt(lifted.positions[i][2] - planes.getLow(), particles.radii[i]);
                const int row = particles.firstRow[i];
                sums += forces(row + axis, c) * felt.col(0);
                if (particles.hasTorque[i]) sums += sign * forces(row + turn, c) * felt.col(1);
            }
            sums = factors * sums;
            for (int i = 0; i < particles.size(); i++) {
                const auto felt =
                    UniformFlow::felt(lifted.positions[i][2] - planes.getLow(), particles.radii[i]);
                const int row = particles.firstRow[i];
                velocities(row + axis, c) += felt.col(0).dot(sums);
                if (particles.hasTorque[i])
                    velocities(row + turn, c) += sign * felt.col(1).dot(sums);
            }
        }
}

MobilityTraits traitsOnGrid(const ConfiningPlanes& planes) {
    MobilityTraits traits("RotnePragerYamakawa");
    traits.mayObject = true;
    traits.holdsNearby = !planes.allowsCrossing();
    traits.isAnchored = true;
    traits.isMatrixFree = true;
    return traits;
}

}  // namespace

ConfinedRotnePragerYamakawaGrid::ConfinedRotnePragerYamakawaGrid(
    const HydrodynamicParticles& particles, double viscosity, double tolerance, double spacing,
    const ConfiningPlanes& planes, const std::shared_ptr<GridFluid>& fluid)
    : MobilityModel(particles, viscosity, traitsOnGrid(planes)), tolerance(tolerance),
      spacing(spacing), planes(planes), fluid(fluid) {
    planes.checkRadii(particles);
    smallest = *std::min_element(particles.radii.begin(), particles.radii.end());
    longest = longestWave(smallest, tolerance);
}

/** The height that the base provides for particles. Above a wall it grows in steps. */
double ConfinedRotnePragerYamakawaGrid::topFor(double top) const {
    if (planes.isChannel()) return planes.getHeight();
    double height = 2 * smallest;
    while (height < top) height *= stepOfHeights;
    return height;
}

/** The distance from walls that the base assumes. */
double ConfinedRotnePragerYamakawaGrid::nearestFor(double nearest) const {
    // Positions in the middle of a step may be a little nearer than at its start.
    const double margin = 1.01;
    double assumed = smallest;
    while (margin * assumed * stepOfHeights <= nearest) assumed *= stepOfHeights;
    return assumed;
}

EwaldSplitting ConfinedRotnePragerYamakawaGrid::splittingFor(const HydrodynamicParticles& particles,
                                                             double tolerance, double spacing,
                                                             const BoxVectors& box, double height,
                                                             double& period, double nearest) {
    const std::vector<EwaldKind> kinds = kindsOf(particles);
    const double smallest = kinds.front().radius, distance = std::max(smallest, nearest),
                 longest = longestWave(distance, tolerance);
    // Stencils of particles at this distance from a wall must not overlap across the end of the
    // box. A higher box than this magnifies rounding errors (docs/theory/walls.md).
    for (period = height + 2 * smallest;;) {
        const EwaldSplitting splitting(kinds, toleranceOfBase(tolerance), spacing,
                                       {box[0], box[1], Vec3(0, 0, period)}, 0, longest);
        const double needed =
            height + 2 * (splitting.cutoff - distance + splitting.shape.spacing(2));
        if (period >= needed) return splitting;
        period = 1.01 * needed;
    }
}

ConfinedRotnePragerYamakawaGrid::Base ConfinedRotnePragerYamakawaGrid::baseFor(
    const BoxVectors& box, double top, double nearest) const {
    // Centres are as far from the end of the height as from the wall.
    const double assumed = nearestFor(nearest), height = topFor(top + assumed - smallest);
    const std::lock_guard<std::mutex> lock(mutex);
    for (const Base& base : bases)
        if (base.height == height && base.nearest == assumed && base.box[0] == box[0] &&
            base.box[1] == box[1])
            return base;
    Base made = {nullptr, height, assumed, 0, longestWave(assumed, tolerance), box};
    const EwaldSplitting here =
        splittingFor(particles, tolerance, spacing, box, height, made.period, assumed);
    WallMaker walls;
    walls.longest = made.longest;
    walls.bytes =
        GridWalls::memory(here.shape) +
        NearPlanes::memory(particles, kindsOf(particles), here, tolerance, height, made.longest);
    walls.make = [planes = planes, longest = made.longest,
                  height](const EwaldSplitting& splitting) {
        return std::make_shared<GridWalls>(
            planes, splitting.shape, height, longest,
            [xi = splitting.xi](double k) { return hasimoto(k, xi); });
    };
    made.model = std::make_shared<RotnePragerYamakawaGrid>(
        particles, viscosity, toleranceOfBase(tolerance), spacing, fluid, walls);
    // check() needs the lowest base at contact, and placements need others.
    const size_t most = 4;
    if (bases.size() == most) bases.erase(bases.begin());
    bases.push_back(made);
    return made;
}

bool ConfinedRotnePragerYamakawaGrid::holds(const Base& base, double top, double nearest,
                                            double beyond) const {
    return (planes.isChannel() || top + base.nearest - smallest <= base.height * (1 + beyond)) &&
           (base.nearest == smallest || nearest >= base.nearest * (1 - beyond));
}

bool ConfinedRotnePragerYamakawaGrid::acceptsNearby(const Placement& placement) const {
    if (planes.allowsCrossing()) return objection(placement).empty();
    const double beyond = 0.01;  // of a radius
    return planes.areWithin(particles, placement, beyond);
}

void ConfinedRotnePragerYamakawaGrid::check(const BoxVectors& box) const {
    planes.checkBox(box);
    checkBoxOfGrid(name(), {box[0], box[1], Vec3(0, 0, 1)});
    if (spacing > M_PI / longest)
        refuseGrid(name(), "with walls needs a spacing of at most " + text(M_PI / longest) +
                               " nm for the tolerance " + text(tolerance, 3) +
                               " beside particles of radius " + text(smallest) +
                               " nm, but setGridSpacing() gives " + text(spacing) +
                               " nm; lower it or set it to 0 (chosen by the tolerance), or raise "
                               "setSolverTolerance()");
    const Base base = baseFor(box, 3 * smallest);
    base.model->box()->check({box[0], box[1], Vec3(0, 0, base.period)});
}

double ConfinedRotnePragerYamakawaGrid::volume(const BoxVectors& box) const {
    return planeArea(box) * planes.getHeight();
}

void ConfinedRotnePragerYamakawaGrid::checkWave(const BoxVectors& box, int axis,
                                                int periods) const {
    checkPeriodicWave(box, axis, periods);
}

std::string ConfinedRotnePragerYamakawaGrid::describe(const BoxVectors& box) const {
    const Base base = baseFor(box, 3 * smallest);
    return base.model->grid()->describe({box[0], box[1], Vec3(0, 0, base.period)});
}

WaveFactors ConfinedRotnePragerYamakawaGrid::waveFactors(double radius, double k) const {
    return overSurfaces().waveFactors(radius, k);
}

void ConfinedRotnePragerYamakawaGrid::lift(const Placement& placement, bool nearby,
                                           Lifted& lifted) const {
    lifted.positions = placement.positions;
    lifted.weights.resize(0);
    lifted.top = 0;
    lifted.nearest = std::numeric_limits<double>::infinity();
    for (int i = 0; i < particles.size(); i++) {
        const double radius = particles.radii[i];
        if (!nearby) {
            lifted.positions[i] = planes.placeInFormulas(placement.positions[i], radius);
            const double weight =
                planes.allowsCrossing() ? planes.weight(placement.positions[i][2], radius) : 1;
            if (weight < 1) {
                if (lifted.weights.size() == 0) lifted.weights.setOnes(particles.numRows);
                lifted.weights.segment(particles.firstRow[i], particles.hasTorque[i] ? 6 : 3)
                    .setConstant(weight);
            }
        }
        const double z = lifted.positions[i][2] - planes.getLow();
        lifted.top = std::max(lifted.top, z + radius);
        lifted.nearest = std::min(
            {lifted.nearest, z, planes.isChannel() ? planes.getHeight() - z : lifted.nearest});
    }
}

void ConfinedRotnePragerYamakawaGrid::draw(const NoiseStream& noise, uint32_t purpose,
                                           const BoxVectors& box,
                                           std::unique_ptr<RandomField>& field) const {
    if (!field) field = std::make_unique<ConfinedRandomField>(*this);
    static_cast<ConfinedRandomField&>(*field).draw(noise, purpose, box);
}

std::unique_ptr<MobilityAt> ConfinedRotnePragerYamakawaGrid::makePlace() const {
    return std::make_unique<ConfinedOnGrid>(*this);
}

}  // namespace RigidHIPlugin
