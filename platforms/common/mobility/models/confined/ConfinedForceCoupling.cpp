#include "mobility/models/confined/ConfinedForceCoupling.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "mobility/models/confined/PlaneConditions.h"
#include "mobility/models/forcecoupling/Envelopes.h"
#include "mobility/models/forcecoupling/GridChecks.h"
#include "mobility/models/forcecoupling/GridPlanes.h"
#include "mobility/models/periodic/MostLatticeRows.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/wall/NoSlipPlane.h"
#include "openmmrigidhi/internal/Messages.h"

using Eigen::MatrixXd;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

const MobilityModel& asModel(const ForceCouplingGrid& model) { return model; }

/** The mobility at a placement: that of the periodic model at the corresponding placement. */
class ConfinedForceCouplingAt : public MobilityAt {
public:
    explicit ConfinedForceCouplingAt(const ConfinedForceCoupling& model)
        : MobilityAt(model), model(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        onGrid->multiply(forces, velocities, model.mayRound(here.box) ? accuracy : Accuracy());
    }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        // Points may be above the grid of the particles.
        std::vector<Vec3> all = here.positions;
        all.insert(all.end(), points.begin(), points.end());
        const double needed = model.periodFor(all);
        if (needed <= period) {
            onGrid->addFlowAt(sources, model.inPeriodic(points), factor, velocities);
            return;
        }
        Placement inPeriodic;
        model.toPeriodic(here, needed, inPeriodic);
        asModel(model.inPeriodicBox())
            .at(inPeriodic)
            ->addFlowAt(sources, model.inPeriodic(points), factor, velocities);
    }
    /** Symmetric to the last bit. */
    void dense(MatrixXd& mobility) override {
        MobilityAt::dense(mobility);
        mobility = (0.5 * (mobility + mobility.transpose())).eval();
    }
    double getSecondsOfGrid() const override { return onGrid ? onGrid->getSecondsOfGrid() : 0; }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        // Differences need one grid.
        if (!nearby || !onGrid) period = model.periodFor(placement.positions);
        here = placement;
        Placement inPeriodic;
        model.toPeriodic(placement, period, inPeriodic);
        if (nearby)
            asModel(model.inPeriodicBox()).placeNear(onGrid, inPeriodic);
        else
            asModel(model.inPeriodicBox()).place(onGrid, inPeriodic);
    }

private:
    const ConfinedForceCoupling& model;
    Placement here;
    double period = 0;
    std::unique_ptr<MobilityAt> onGrid;
};

/**
 * The field of the periodic model, drawn at its first use. If a placement is above the grid of the
 * field, the field is drawn again on a higher grid.
 */
class Field : public RandomField {
public:
    explicit Field(const ConfinedForceCoupling& model) : model(model) {}
    void draw(const NoiseStream& newNoise, uint32_t newPurpose) {
        noise = newNoise;
        purpose = newPurpose;
        isDrawn = false;
    }
    void slipsAt(const Placement& placement, bool nearby, MatrixXd& slips) override {
        moveTo(placement);
        onGrid->slipsAt(inPeriodic, nearby, slips);
    }
    bool hasGradients() const override { return true; }
    void gradientsAt(const Placement& placement, bool nearby, MatrixXd& gradients) override {
        moveTo(placement);
        onGrid->gradientsAt(inPeriodic, nearby, gradients);
    }
    void addFlowAt(const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        const double top = model.topOf(period);
        for (size_t p = 0; p < points.size(); p++)
            if (!(points[p][2] <= top))
                refuseGrid(model.name(), "has no random flow above z = " + text(top) +
                                             " nm, but point " + std::to_string(p) +
                                             " is at z = " + text(points[p][2]) +
                                             " nm; give points that are not so far above the "
                                             "particles, or ask at the temperature 0");
        onGrid->addFlowAt(model.inPeriodic(points), factor, velocities);
    }
    double amplitudeOf(const DrivenFlow& wave) override {
        DrivenFlow inPeriodic = wave;
        for (double* z : {&inPeriodic.low, &inPeriodic.high, &inPeriodic.top})
            *z = model.inPeriodic(*z);
        return onGrid->amplitudeOf(inPeriodic);
    }
    Eigen::Vector3d meanFlow(double low, double high) override {
        return onGrid->meanFlow(model.inPeriodic(low), model.inPeriodic(high));
    }
    long long getNumRandomNumbers() const override {
        return isDrawn ? onGrid->getNumRandomNumbers() : 0;
    }

private:
    void drawFor(const Placement& placement) {
        period = model.periodFor(placement.positions);
        model.toPeriodic(placement, period, inPeriodic);
        asModel(model.inPeriodicBox()).randomField()->draw(noise, purpose, inPeriodic.box, onGrid);
        isDrawn = true;
    }
    void moveTo(const Placement& placement) {
        if (!isDrawn || !model.holds(period, placement.positions)) drawFor(placement);
        model.toPeriodic(placement, period, inPeriodic);
    }

    const ConfinedForceCoupling& model;
    NoiseStream noise;
    uint32_t purpose = 0;
    bool isDrawn = false;
    double period = 0;
    Placement inPeriodic;
    std::unique_ptr<RandomField> onGrid;
};

/** The traits of the periodic model, changed for walls. */
MobilityTraits betweenPlanes(MobilityTraits traits, bool byProducts) {
    traits.mayObject = traits.holdsNearby = true;
    traits.isHomogeneous = traits.isIsotropic = traits.isDivergenceFree = false;
    traits.isMatrixFree = byProducts;
    return traits;
}

/** In largest radii: the gap of the period, and how far another plane is below a PeriodicWall. */
const double gapInRadii = 2, belowInRadii = 1.5;

double largestOf(const std::vector<double>& numbers) {
    return numbers.empty() ? 0 : *std::max_element(numbers.begin(), numbers.end());
}

}  // namespace

struct ConfinedForceCoupling::Made {
    GridShape shape;
    std::shared_ptr<const GridPlanes> planes;
};

ConfinedForceCoupling::ConfinedForceCoupling(const HydrodynamicParticles& particles,
                                             double viscosity, const ConfiningPlanes& planes,
                                             double tolerance, double spacing,
                                             const std::shared_ptr<GridFluid>& fluid,
                                             bool byProducts)
    : MobilityModel(
          particles, viscosity,
          betweenPlanes(
              ForceCouplingGrid(particles, viscosity, tolerance, spacing, fluid).getTraits(),
              byProducts)),
      planes(planes), gap(gapInRadii * largestOf(particles.radii)),
      below(planes.isWall() ? behindWalls(particles, planes.getBoundary()) : 0),
      origin(planes.isWall() ? -below / 2 : planes.getHeight() / 2),
      onGrid(particles, viscosity, tolerance, spacing, fluid, false,
             [this](const GridShape& shape) { return planesOf(shape); }) {
    planes.checkRadii(particles);
    if (!byProducts) checkPeriodicRows(particles.numRows, mostLatticeRows);
}

ConfinedForceCoupling::~ConfinedForceCoupling() {}

double ConfinedForceCoupling::behindWalls(const HydrodynamicParticles& particles,
                                          MobilityForce::Boundary boundary) {
    // In a channel or film this is the other plane's image.
    return (boundary == MobilityForce::PeriodicWall ? belowInRadii : gapInRadii) *
           largestOf(particles.radii);
}

WaveFactors ConfinedForceCoupling::waveFactors(double radius, double k) const {
    WaveFactors factors = onGrid.waveFactors(radius, k);
    factors.width = forceEnvelopeWidth(radius);
    factors.torqueWidth = torqueEnvelopeWidth(radius);
    factors.gap = gap;
    return factors;
}

double ConfinedForceCoupling::beyondHeight(const HydrodynamicParticles& particles,
                                           MobilityForce::Boundary boundary) {
    return (gapInRadii + (boundary == MobilityForce::PeriodicWall ? belowInRadii : 0)) *
           largestOf(particles.radii);
}

PlaneConditions ConfinedForceCoupling::conditionsOf(double period) const {
    if (planes.isChannel())
        return PlaneConditions::channel(planes.getHeight(), gap, planes.hasZeroFlux());
    if (planes.isFilm()) return PlaneConditions::film(planes.getHeight(), gap);
    return PlaneConditions::wall(period - gap - below, gap, below);
}

std::shared_ptr<const GridPlanes> ConfinedForceCoupling::planesOf(const GridShape& shape) const {
    const size_t most = 4;
    const std::lock_guard<std::mutex> lock(madeMutex);
    for (const Made& each : made)
        if (each.shape == shape) return each.planes;
    if (made.size() == most) made.erase(made.begin());
    made.push_back({shape, std::make_shared<GridPlanes>(conditionsOf(shape.edge[2]), shape)});
    return made.back().planes;
}

double ConfinedForceCoupling::periodFor(const std::vector<Vec3>& positions) const {
    if (!planes.isWall()) return planes.getHeight() + gap;
    // Take integer numbers of nodes with fast transforms, so that the period usually stays the same
    // from step to step.
    double top = gap;
    int highest = 0;
    for (size_t i = 0; i < positions.size(); i++) {
        // Positions after those of particles are points of the fluid.
        const double reach = i < particles.radii.size()
                                 ? onGrid.getResolution().cutoff(particles.radii[i])
                                 : 0,
                     end = positions[i][2] - planes.getLow() + reach;
        if (end > top) {
            top = end;
            highest = i;
        }
    }
    const double spacing = onGrid.getResolution().getSpacingAcross();
    const int nodes = nextGridSize((top + gap + below) / spacing);
    if (nodes == tooManyNodes)
        refuseGrid(
            name(),
            "reaches from the wall to the highest particle, but " +
                (highest < static_cast<int>(particles.size()) ? particleAndBody(particles, highest)
                                                              : std::string("a point")) +
                " is at z = " + text(positions[highest][2]) + " nm; bring it nearer to the wall");
    return nodes * spacing;
}

bool ConfinedForceCoupling::holds(double period, const std::vector<Vec3>& positions) const {
    if (!planes.isWall()) return true;
    // Beyond this distance an envelope is less than the tolerance. periodFor() leaves more.
    const double inWidths = std::sqrt(2 * std::log(2 / onGrid.getResolution().getTolerance())),
                 top = topOf(period);
    for (size_t i = 0; i < positions.size(); i++)
        if (!(positions[i][2] + inWidths * forceEnvelopeWidth(particles.radii[i]) <= top))
            return false;
    return true;
}

double ConfinedForceCoupling::topOf(double period) const {
    return planes.isWall() ? planes.getLow() + (period - gap - below) : planes.getHigh();
}

bool ConfinedForceCoupling::mayRound(const BoxVectors& box) const {
    const double nearest = planes.isWall() ? below : planes.getHeight();
    return std::max(box[0][0], box[1][1]) <= flattestInSingle * nearest;
}

BoxVectors ConfinedForceCoupling::periodicBox(const BoxVectors& box, double period) const {
    return {box[0], box[1], Vec3(0, 0, period)};
}

void ConfinedForceCoupling::toPeriodic(const Placement& placement, double period,
                                       Placement& result) const {
    check(placement.box, period);
    result.box = periodicBox(placement.box, period);
    result.positions = inPeriodic(placement.positions);
}

std::vector<Vec3> ConfinedForceCoupling::inPeriodic(const std::vector<Vec3>& points) const {
    std::vector<Vec3> shifted = points;
    for (Vec3& x : shifted) x[2] = inPeriodic(x[2]);
    return shifted;
}

void ConfinedForceCoupling::check(const BoxVectors& box, double period) const {
    planes.checkBox(box);
    if (box[1][0] != 0)
        refuseGrid(name(),
                   "needs a box with edges along the axes, but the periodic box has the "
                   "vectors " +
                       text(box[0]) + ", " + text(box[1]) + ", " + text(box[2]) +
                       " nm; set another box by setPeriodicBoxVectors() on the Context");
    const BoxVectors periodic = periodicBox(box, period);
    asModel(onGrid).box()->check(periodic);
    // Planes need memory, so the check comes before them.
    const GridShape shape = onGrid.nodesFor(periodic);
    const double ofPlanes = GridPlanes::memory(planes.isWall() ? 3 : 2, shape);
    bool areMade = false;
    {
        const std::lock_guard<std::mutex> lock(madeMutex);
        for (const Made& each : made) areMade = areMade || each.shape == shape;
    }
    checkMemoryOfGrid(name(), shape, GridFluid::memory(shape) + ofPlanes,
                      onGrid.getFluid().memoryHeld() + (areMade ? ofPlanes : 0),
                      " and for planes beside them");
}

double ConfinedForceCoupling::volume(const BoxVectors& box) const {
    return box[0][0] * box[1][1] * planes.getHeight();
}

void ConfinedForceCoupling::checkWave(const BoxVectors& box, int axis, int periods) const {
    asModel(onGrid).box()->checkWave(periodicBox(box, periodFor({})), axis, periods);
}

std::string ConfinedForceCoupling::describe(const BoxVectors& box) const {
    const double period = periodFor({});
    std::string result = asModel(onGrid).grid()->describe(periodicBox(box, period));
    if (planes.isWall())
        return result + ", higher where particles are, with planes in a period of " + text(period) +
               " nm or more";
    return result + ", with planes in a period of " + text(period) + " nm";
}

void ConfinedForceCoupling::draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
                                 std::unique_ptr<RandomField>& field) const {
    if (!field) field = std::make_unique<Field>(*this);
    check(box);
    static_cast<Field&>(*field).draw(noise, purpose);
}

std::unique_ptr<MobilityAt> ConfinedForceCoupling::makePlace() const {
    return std::make_unique<ConfinedForceCouplingAt>(*this);
}

}  // namespace RigidHIPlugin
