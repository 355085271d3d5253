#include "mobility/models/forcecoupling/ForceCouplingGrid.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "mobility/models/ewald/WaveField.h"
#include "mobility/models/forcecoupling/Envelopes.h"
#include "mobility/models/forcecoupling/GridChecks.h"
#include "mobility/models/forcecoupling/GridMeans.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace Eigen;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

/**
 * The particles of a model on its grid, at one placement: with their own envelopes or, in a
 * triclinic box, as channels.
 */
class ParticlesOnGrid {
public:
    explicit ParticlesOnGrid(const ForceCouplingGrid& model)
        : model(model), stencils(model.getParticles(), model.getResolution()),
          channels(model.getParticles(), model.getKinds()) {}
    void setBox(const BoxVectors& box) {
        std::shared_ptr<const ForceCouplingSkewBox> now = model.skewBox(box);
        if (!now) {
            shape = model.shapeFor(box);
            stencils.layOut(shape);
        } else if (now != skewBox) {
            shape = now->shape;
            channels.setGrid(shape, now->width, now->resolution, now->factors);
        }
        skewBox = std::move(now);
    }
    void moveTo(const std::vector<Vec3>& positions, bool keepAnchors) {
        if (skewBox)
            channels.moveTo(positions, keepAnchors);
        else
            stencils.moveTo(shape, positions, keepAnchors);
    }
    void multiply(const MatrixXd& forces, bool inSingle, MatrixXd& velocities) {
        GridFluid& fluid = model.getFluid();
        if (skewBox) {
            velocities.setZero(forces.rows(), forces.cols());
            for (int c = 0; c < forces.cols(); c++)
                channels.addProduct(fluid, model.getViscosity(), inSingle, forces.col(c).data(),
                                    velocities.col(c).data());
        } else if (inSingle)
            fluid.multiplyInSingle(stencils, model.getViscosity(), forces, velocities);
        else
            fluid.multiply(stencils, model.getViscosity(), forces, velocities);
    }
    void draw(const NoiseStream& noise, uint32_t purpose, std::vector<GridField>& fields) {
        GridFluid& fluid = model.getFluid();
        if (skewBox) return channels.draw(fluid, model.getViscosity(), noise, purpose, fields);
        fields.resize(1);
        fluid.draw(stencils, model.getViscosity(), noise, purpose, fields[0]);
    }
    void average(const std::vector<GridField>& fields, VectorXd& velocities) {
        if (!skewBox) return model.getFluid().average(fields[0], stencils, velocities);
        velocities.setZero(model.getParticles().numRows);
        channels.addAverages(model.getFluid(), fields, velocities.data());
    }
    const GridShape& getShape() const { return shape; }
    /** Null in a triclinic box, where particles do not have their own envelopes. */
    const GridStencils* getStencils() const { return skewBox ? nullptr : &stencils; }

private:
    const ForceCouplingGrid& model;
    GridShape shape;
    GridStencils stencils;
    WaveField channels;
    std::shared_ptr<const ForceCouplingSkewBox> skewBox;
};

class ForceCouplingGridAt : public MobilityAt {
public:
    explicit ForceCouplingGridAt(const ForceCouplingGrid& model)
        : MobilityAt(model), model(model), onGrid(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        prepare();
        const ScopedTimer timer(secondsOfGrid);
        onGrid.multiply(forces, accuracy.allowsSinglePrecision(), velocities);
    }

    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        prepare();
        if (const GridStencils* stencils = onGrid.getStencils()) {
            GridFlow flow;
            flow.spread(*stencils, viscosity, sources.forces.col(0).data());
            flow.addAt(points, factor, velocities);
            return;
        }
        LatticeSum flow(particles, overGaussians(), false, true);
        flow.setBox(next.box);
        flow.addFlowAt(next.positions, sources, points, factor / (8 * M_PI * viscosity),
                       velocities);
    }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        model.box()->check(placement.box);
        // A nearby placement is close to the previous placement, where the anchors must be.
        if (nearby) prepare();
        next = placement;
        nextIsNearby = nearby;
        isPrepared = false;
    }

private:
    /**
     * Weights wait for the first product, because schemes also move to placements without asking
     * for a product there.
     */
    void prepare() {
        if (isPrepared) return;
        onGrid.setBox(next.box);
        onGrid.moveTo(next.positions, nextIsNearby);
        isPrepared = true;
    }
    const ForceCouplingGrid& model;
    ParticlesOnGrid onGrid;
    Placement next;
    bool nextIsNearby = false, isPrepared = true;
};

class Field : public RandomField {
public:
    explicit Field(const ForceCouplingGrid& model) : model(model), onGrid(model) {}
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& newBox) {
        model.box()->check(newBox);
        ofDraw = noise;
        purposeOfDraw = purpose;
        drawIn(newBox);
        isThere = isAveraged = false;
    }
    void slipsAt(const Placement& placement, bool nearby, MatrixXd& slips) override {
        moveTo(placement, nearby);
        if (!isAveraged) onGrid.average(fields, velocities);
        isAveraged = true;
        slips = velocities;
    }
    void addFlowAt(const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        GridFlow flow;
        if (const GridStencils* stencils = onGrid.getStencils())
            flow.draw(*stencils, model.getViscosity(), CounterModeNoise(ofDraw, purposeOfDraw));
        else {
            // Only the modes of channels.
            const GridFactors factors(onGrid.getShape(), [](double k, double) { return 1 / k; });
            flow.draw(onGrid.getShape(), model.getViscosity(),
                      CounterModeNoise(ofDraw, purposeOfDraw), &factors);
        }
        flow.addAt(points, factor, velocities);
    }
    double amplitudeOf(const DrivenFlow& wave) override {
        const GridShape& shape = onGrid.getShape();
        if (wave.hasPlanes) {
            const int index = std::lround(wave.k * shape.edge[wave.waveAxis] / (2 * M_PI));
            const std::complex<double> u = meanOverHeight(inOnePiece(), wave.waveAxis, index,
                                                          wave.low, wave.high)[wave.forceAxis];
            // u exp(ikx) and its conjugate: 2 Re(u) cos(kx) - 2 Im(u) sin(kx)
            return 2 * u.real() * std::sin(wave.phase) - 2 * u.imag() * std::cos(wave.phase);
        }
        return amplitudeOfMode(shape, model.getViscosity(), CounterModeNoise(ofDraw, purposeOfDraw),
                               wave);
    }
    Vector3d meanFlow(double low, double high) override {
        if (!onGrid.getShape().planes) return Vector3d::Zero();
        return meanOverHeight(inOnePiece(), 0, 0, low, high).real();
    }
    bool hasGradients() const override { return onGrid.getStencils() != nullptr; }
    void gradientsAt(const Placement& placement, bool nearby, MatrixXd& gradients) override {
        moveTo(placement, nearby);
        model.getFluid().averageGradients(fields[0], *onGrid.getStencils(), gradients);
    }
    long long getNumRandomNumbers() const override {
        return GridModeNoise::numbersOf(onGrid.getShape());
    }

private:
    void drawIn(const BoxVectors& newBox) {
        box = newBox;
        onGrid.setBox(box);
        onGrid.draw(ofDraw, purposeOfDraw, fields);
    }
    /** The same field in the order of PlainGridFluid; other fluids have their own order. */
    GridField inOnePiece() const {
        PlainGridFluid plain;
        GridField same;
        plain.draw(*onGrid.getStencils(), model.getViscosity(),
                   CounterModeNoise(ofDraw, purposeOfDraw), same);
        return same;
    }
    /**
     * Move to a placement. Schemes ask for slips and their divergence at the same placement, so a
     * second move there does nothing.
     */
    void moveTo(const Placement& placement, bool nearby) {
        // In a box that tilts during a step, the field uses the same numbers in the new box.
        const BoxVectors wanted = vectorsNearTo(box, placement.box);
        if (isThere && nearby == wasNearby && placement.positions == positions && wanted == box)
            return;
        if (wanted != box) drawIn(wanted);
        onGrid.moveTo(placement.positions, nearby);
        positions = placement.positions;
        wasNearby = nearby;
        isThere = true;
        isAveraged = false;
    }
    const ForceCouplingGrid& model;
    ParticlesOnGrid onGrid;
    std::vector<GridField> fields;
    BoxVectors box = {};
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
      resolution(particles, tolerance, spacing), fluid(fluid), planes(planes),
      kinds(kindsOf(particles)) {
    // On a coarser grid, whole particles fit between the nodes, and mobilities are zero or
    // negative.
    const double coarsest = resolution.getCoarsestSpacing();
    if (spacing > coarsest) {
        // Round the value down, so that the spacing named in the message is accepted.
        const double unit = std::pow(10.0, std::floor(std::log10(coarsest)) - 2);
        throw OpenMM::OpenMMException(
            "MobilityForce: setGridSpacing(): the spacing is " + text(spacing) +
            " nm, too coarse for the smallest particle of ForceCoupling on a grid; give at most " +
            text(std::floor(coarsest / unit) * unit, 3) +
            " nm, or 0 for the spacing that the solver tolerance needs");
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

std::shared_ptr<const ForceCouplingSkewBox> ForceCouplingGrid::skewBox(
    const BoxVectors& box) const {
    const GridShape shape = nodesFor(box);
    if (shape.skew.isNone()) return nullptr;
    const std::lock_guard<std::mutex> lock(mutex);
    if (lastSkewBox && lastBox == box) return lastSkewBox;
    const double w = resolution.widthIn(GridLean(box));
    auto made = std::make_shared<ForceCouplingSkewBox>(ForceCouplingSkewBox{
        shape, w, GridResolution::ofPoints(w, resolution.getCutoffInWidths() * w), {}});
    for (const EwaldKind& kind : kinds)
        for (const bool ofTorques : {false, true}) {
            if (ofTorques && kind.torques == 0) continue;
            const double own =
                ofTorques ? torqueEnvelopeWidth(kind.radius) : forceEnvelopeWidth(kind.radius);
            made->factors.push_back(
                std::make_unique<GridFactors>(shape, [&](double k, double ofGrid) {
                    return std::exp(0.5 * (w * w * ofGrid * ofGrid - own * own * k * k)) / k;
                }));
        }
    lastBox = box;
    lastSkewBox = made;
    return made;
}

void ForceCouplingGrid::check(const BoxVectors& box) const {
    const bool mayLean = !planes && !traits.isMirrored;
    checkBoxOfGrid(name(), box, mayLean);
    const GridShape shape = nodesFor(box);
    const double spacing = planes ? resolution.getSpacingAcross() : resolution.getSpacing();
    checkSizeOfGrid(name(), box,
                    shape.skew.isNone()
                        ? spacing
                        : std::min({shape.spacing(0), shape.spacing(1), shape.spacing(2)}));
    int channels = 0;
    for (const EwaldKind& kind : kinds) channels += kind.torques > 0 ? 2 : 1;
    checkMemoryOfGrid(name(), shape,
                      (shape.skew.isNone() ? 1 : channels) * GridFluid::memory(shape),
                      fluid->memoryHeld());
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
    const GridShape shape = resolution.shapeFor(box);
    int nodes = shape.size[axis];
    if (!shape.skew.isNone()) {
        checkPeriodicWave(box, axis, periods);
        // The modes of such a grid fill a ball.
        nodes = std::floor(box[axis][axis] * shape.longestWave() / M_PI);
    }
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
    // Groups of one Context have the same modes, but each group takes its own random numbers, by
    // its first particle.
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
