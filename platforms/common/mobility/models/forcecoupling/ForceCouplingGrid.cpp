#include "mobility/models/forcecoupling/ForceCouplingGrid.h"

#include <openmm/OpenMMException.h>

#include <cmath>

#include "mobility/models/forcecoupling/GridChecks.h"
#include "mobility/models/forcecoupling/GridMeans.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace Eigen;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

class ForceCouplingGridAt : public MobilityAt {
public:
    explicit ForceCouplingGridAt(const ForceCouplingGrid& model)
        : MobilityAt(model), model(model), stencils(model.getParticles(), model.getResolution()) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        prepare();
        const ScopedTimer timer(secondsOfGrid);
        if (accuracy.allowsSinglePrecision())
            model.getFluid().multiplyInSingle(stencils, viscosity, forces, velocities);
        else
            model.getFluid().multiply(stencils, viscosity, forces, velocities);
    }

    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        prepare();
        GridFlow flow;
        flow.spread(stencils, viscosity, sources.forces.col(0).data());
        flow.addAt(points, factor, velocities);
    }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        model.box()->check(placement.box);
        // A nearby placement is near the placement before, where the anchors must be.
        if (nearby) prepare();
        next = placement;
        nextIsNearby = nearby;
        isPrepared = false;
    }

private:
    /**
     * Weights are made for the first product, because schemes also move to placements where they
     * ask for no product.
     */
    void prepare() {
        if (isPrepared) return;
        stencils.moveTo(model.shapeFor(next.box), next.positions, nextIsNearby);
        isPrepared = true;
    }
    const ForceCouplingGrid& model;
    GridStencils stencils;
    Placement next;
    bool nextIsNearby = false, isPrepared = true;
};

class Field : public RandomField {
public:
    explicit Field(const ForceCouplingGrid& model)
        : model(model), stencils(model.getParticles(), model.getResolution()) {}
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& newBox) {
        model.box()->check(newBox);
        box = newBox;
        ofDraw = noise;
        purposeOfDraw = purpose;
        stencils.layOut(model.shapeFor(box));
        model.getFluid().draw(stencils, model.getViscosity(), noise, purpose, field);
        isThere = isAveraged = false;
    }
    void slipsAt(const Placement& placement, bool nearby, MatrixXd& slips) override {
        moveTo(placement, nearby);
        if (!isAveraged) model.getFluid().average(field, stencils, velocities);
        isAveraged = true;
        slips = velocities;
    }
    void addFlowAt(const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        GridFlow flow;
        flow.draw(stencils, model.getViscosity(), CounterModeNoise(ofDraw, purposeOfDraw));
        flow.addAt(points, factor, velocities);
    }
    double amplitudeOf(const DrivenFlow& wave) override {
        if (wave.hasPlanes) {
            const int index = std::lround(wave.k * field.shape.edge[wave.waveAxis] / (2 * M_PI));
            const std::complex<double> u = meanOverHeight(inOnePiece(), wave.waveAxis, index,
                                                          wave.low, wave.high)[wave.forceAxis];
            // u exp(ikx) and its conjugate: 2 Re(u) cos(kx) - 2 Im(u) sin(kx)
            return 2 * u.real() * std::sin(wave.phase) - 2 * u.imag() * std::cos(wave.phase);
        }
        return amplitudeOfMode(field.shape, model.getViscosity(),
                               CounterModeNoise(ofDraw, purposeOfDraw), wave);
    }
    Vector3d meanFlow(double low, double high) override {
        if (!field.shape.planes) return Vector3d::Zero();
        return meanOverHeight(inOnePiece(), 0, 0, low, high).real();
    }
    bool hasGradients() const override { return true; }
    void gradientsAt(const Placement& placement, bool nearby, MatrixXd& gradients) override {
        moveTo(placement, nearby);
        model.getFluid().averageGradients(field, stencils, gradients);
    }
    long long getNumRandomNumbers() const override { return GridModeNoise::numbersOf(field.shape); }

private:
    /** The same field as PlainGridFluid arranges it; other fluids have an order of their own. */
    GridField inOnePiece() const {
        PlainGridFluid plain;
        GridField same;
        plain.draw(stencils, model.getViscosity(), CounterModeNoise(ofDraw, purposeOfDraw), same);
        return same;
    }
    /**
     * Schemes ask for slips and for their divergence at one placement. Nothing is computed twice
     * there.
     */
    void moveTo(const Placement& placement, bool nearby) {
        if (isThere && nearby == wasNearby && placement.positions == positions) return;
        stencils.moveTo(field.shape, placement.positions, nearby);
        positions = placement.positions;
        wasNearby = nearby;
        isThere = true;
        isAveraged = false;
    }
    const ForceCouplingGrid& model;
    GridStencils stencils;
    GridField field;
    BoxVectors box;
    std::vector<Vec3> positions;
    NoiseStream ofDraw;
    uint32_t purposeOfDraw = 0;
    bool isThere = false, wasNearby = false, isAveraged = false;
    VectorXd velocities;
};

}  // namespace

namespace {

MobilityTraits traitsOnGrid(bool mirrored, bool singlePrecision) {
    MobilityTraits traits("ForceCoupling");
    traits.isAnchored = true;
    traits.isHomogeneous = traits.isDivergenceFree = !mirrored;
    traits.isMirrored = mirrored;
    traits.hasSinglePrecision = singlePrecision;
    traits.isMatrixFree = true;
    return traits;
}

}  // namespace

ForceCouplingGrid::ForceCouplingGrid(const HydrodynamicParticles& particles, double viscosity,
                                     double tolerance, double spacing,
                                     const std::shared_ptr<GridFluid>& fluid, bool mirrored,
                                     const PlanesOfGrid& planes)
    : MobilityModel(particles, viscosity, traitsOnGrid(mirrored, fluid->hasSinglePrecision())),
      resolution(particles, tolerance, spacing), fluid(fluid), planes(planes) {
    // With a still coarser grid, whole particles are between the nodes, and mobilities are zero or
    // negative.
    const double coarsest = resolution.getCoarsestSpacing();
    if (spacing > coarsest) {
        // The value is rounded down, so that the spacing that the message names is accepted.
        const double unit = std::pow(10.0, std::floor(std::log10(coarsest)) - 2);
        throw OpenMM::OpenMMException(
            "MobilityForce: setGridSpacing(): the spacing is " + text(spacing) +
            " nm, too coarse for the smallest particle of ForceCoupling on a grid; give at most " +
            text(std::floor(coarsest / unit) * unit, 3) +
            " nm, or 0 for the spacing that the solver tolerance wants");
    }
}

GridShape ForceCouplingGrid::shapeFor(const BoxVectors& box) const {
    GridShape shape = nodesFor(box);
    if (planes) shape.planes = planes(shape);
    return shape;
}

GridShape ForceCouplingGrid::nodesFor(const BoxVectors& box) const {
    GridShape shape = planes ? resolution.shapeBetweenPlanes(box) : resolution.shapeFor(box);
    shape.mirrored = traits.isMirrored;
    return shape;
}

void ForceCouplingGrid::check(const BoxVectors& box) const {
    checkBoxOfGrid(name(), box);
    checkSizeOfGrid(name(), box, planes ? resolution.getSpacingAcross() : resolution.getSpacing());
    const GridShape shape = nodesFor(box);
    checkMemoryOfGrid(name(), shape, GridFluid::memory(shape), fluid->memoryHeld());
}

std::string ForceCouplingGrid::describe(const BoxVectors& box) const {
    const GridShape shape = nodesFor(box);
    return "a grid of " + std::to_string(shape.size[0]) + " x " + std::to_string(shape.numRows()) +
           " x " + std::to_string(shape.size[2]) + " nodes, whose products have the tolerance " +
           text(resolution.getTolerance(), 3);
}

WaveFactors ForceCouplingGrid::waveFactors(double radius, double k) const {
    return overGaussians().waveFactors(radius, k);
}

void ForceCouplingGrid::checkWave(const BoxVectors& box, int axis, int periods) const {
    const int nodes = resolution.shapeFor(box).size[axis];
    if (2 * periods < nodes) return;
    throw OpenMM::OpenMMException("MobilityForce: a wave of index " + text(periods) +
                                  " along the edge " + text(axis) +
                                  " of the box is too short for a grid of " + text(nodes) +
                                  " nodes along it; take an index below " + text((nodes + 1) / 2) +
                                  ", or a finer grid by setGridSpacing()");
}

void ForceCouplingGrid::draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
                             std::unique_ptr<RandomField>& field) const {
    if (!field) field = std::make_unique<Field>(*this);
    // Groups of one Context have the same modes, but each group has its own numbers: those of its
    // first particle.
    NoiseStream own = noise;
    own.field = 1 + particles.systemIndex[0];
    static_cast<Field&>(*field).draw(own, purpose, box);
}

void ForceCouplingGrid::ownMobility(const HydrodynamicParticles& body,
                                    const std::vector<Vec3>& sites, MatrixXd& mobility) const {
    freeForceCoupling(body, sites, viscosity, mobility);
}

std::unique_ptr<MobilityAt> ForceCouplingGrid::makePlace() const {
    return std::make_unique<ForceCouplingGridAt>(*this);
}

}  // namespace RigidHIPlugin
